"""Small robots as URDF texts: a crane of boxes with every kind of joint, and fields as `[robot]` has them once read."""

import numpy as np

from problems.robots.meshes import encode_mesh

CRANE = """<robot name="crane">
  <link name="base"><collision><geometry><box size="0.3 0.3 0.1"/></geometry></collision></link>
  <joint name="turn" type="continuous"><origin xyz="0 0 0.1" rpy="0 0 0.2"/><axis xyz="0 0 1"/>
    <parent link="base"/><child link="tower"/></joint>
  <link name="tower"><collision><origin xyz="0 0 0.2"/><geometry><cylinder radius="0.05" length="0.3"/></geometry></collision></link>
  <joint name="lift" type="prismatic"><origin xyz="0.02 0 0.4"/><axis xyz="0 0 1"/><limit lower="-0.1" upper="0.3"/>
    <parent link="tower"/><child link="slide"/></joint>
  <link name="slide"><collision><geometry><sphere radius="0.07"/></geometry></collision></link>
  <joint name="bend" type="revolute"><origin xyz="0.12 0 0" rpy="0.3 0 0"/><axis xyz="0 1 1"/><limit lower="-2" upper="2.2"/>
    <parent link="slide"/><child link="boom"/></joint>
  <link name="boom"><collision><origin xyz="0.2 0 0" rpy="0 1.5707963 0"/><geometry><capsule radius="0.03" length="0.35"/></geometry></collision></link>
  <joint name="curl" type="revolute"><origin xyz="0.45 0 0"/><axis xyz="0 1 0"/><limit lower="-2" upper="2"/>
    <parent link="boom"/><child link="hand"/></joint>
  <link name="hand"><collision><geometry><mesh filename="package://crane/hand.stl"/></geometry></collision></link>
  <joint name="follow" type="revolute"><origin xyz="0.1 0 0"/><axis xyz="0 0 1"/><limit lower="-3" upper="3"/>
    <mimic joint="curl" multiplier="-0.5" offset="0.1"/><parent link="hand"/><child link="finger"/></joint>
  <link name="finger"><collision><origin xyz="0.06 0 0"/><geometry><box size="0.1 0.02 0.02"/></geometry></collision></link>
  <joint name="weld" type="fixed"><origin xyz="0.1 0 0"/><parent link="finger"/><child link="tip"/></joint>
  <link name="tip"/>
</robot>"""  # noqa: E501
JOINTS = ["turn", "lift", "bend", "curl"]
LIMITS = np.array([[-2 * np.pi, 2 * np.pi], [-0.1, 0.3], [-2.0, 2.2], [-2.0, 2.0]])

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
     [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


def cubes(*cubes):
    """A mesh of several cubes, each a centre and a half edge; two or more are not convex."""
    vertices = np.concatenate([np.asarray(centre) + half * CORNERS for centre, half in cubes])
    return encode_mesh(vertices, np.concatenate([FACES + 8 * number for number in range(len(cubes))]))


HAND = cubes(((0.0, 0.0, 0.0), 0.03), ((0.05, 0.0, 0.03), 0.02))


def crane(**fields):
    """The fields of ``[robot]``, as they are once the files have been read."""
    return {"urdf": CRANE, "srdf": None, "meshes": {"package://crane/hand.stl": HAND}} | fields


def srdf(*pairs):
    lines = "".join(f'<disable_collisions link1="{one}" link2="{other}" reason="Never"/>' for one, other in pairs)
    return f'<robot name="crane">{lines}</robot>'
