"""Small robots as URDF texts, and files of them; no package is needed to read them but for meshes."""

import numpy as np

BOX = '<collision><origin xyz="0 0 0.1"/><geometry><box size="0.05 0.04 0.2"/></geometry></collision>'


def link(name, collision=BOX):
    return f'<link name="{name}">{collision}</link>'


def limit(lower, upper):
    return f'<limit lower="{lower}" upper="{upper}" velocity="1" effort="5"/>'


def joint(name, parent, child, kind="revolute", extra=None, **own):
    extra = limit(-2, 2.5) if extra is None else extra
    xyz, rpy, axis = own.get("xyz", "0 0 0.25"), own.get("rpy", "0 0 0"), own.get("axis", "0 1 0")
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/>{extra}</joint>'
    )


def robot(*parts):
    return f'<robot name="tiny">{"".join(parts)}</robot>'


ARM = robot(
    link("base"),
    link("upper"),
    link("fore"),
    link("slide"),
    link("tool"),
    link("follower"),
    joint("turn", "base", "upper", axis="0 0 1", rpy="0.1 0.2 0.3"),
    joint("bend", "upper", "fore", extra=limit(-2, 3.1), axis="0 2 0"),
    joint("reach", "fore", "slide", "prismatic", limit(0.05, 0.3), axis="0 0 1"),
    joint("mount", "slide", "tool", "fixed", "", rpy="0 1.2 0"),
    joint("finger", "tool", "follower", extra=limit(-1, 1) + '<mimic joint="bend" multiplier="-0.5" offset="0.1"/>'),
)  # fmt: skip
SRDF = """<robot name="tiny">
  <group name="arm"><chain base_link="base" tip_link="tool"/></group>
  <group name="first"><joint name="turn"/></group>
  <group name="second"><link name="fore"/><link name="slide"/></group>
  <group name="all"><group name="second"/><group name="first"/></group>
  <group_state group="arm" name="home"><joint name="bend" value="1.5"/></group_state>
  <disable_collisions link1="base" link2="fore" reason="Never"/>
</robot>
"""


def stl(path, vertices, triangles):
    """Write a mesh as a binary STL."""
    data = np.zeros(len(triangles), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("more", "<u2")])
    data["corners"] = vertices[triangles]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"\0" * 80 + np.uint32(len(triangles)).tobytes() + data.tobytes())


def lump(seed, rows=24):
    """Return a closed, bumpy mesh about the origin, of about 10 cm."""
    random = np.random.default_rng(seed)
    heights, turns = np.meshgrid(np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False))
    waves = 0.1 * (1 + 0.3 * np.sin(3 * turns + random.random()) * np.sin(heights) ** 2 + 0.2 * np.cos(4 * heights))
    x, y, z = waves * np.sin(heights) * np.cos(turns), waves * np.sin(heights) * np.sin(turns), waves * np.cos(heights)
    vertices = np.stack([x, y, z], axis=-1).reshape(-1, 3) * [1.0, 0.8, 1.5]
    number = np.arange(2 * rows * rows).reshape(2 * rows, rows)
    here, beside = number[:, :-1], np.roll(number, -1, axis=0)[:, :-1]
    faces = [
        np.stack(each, axis=-1).reshape(-1, 3) for each in ((here, beside, here + 1), (beside, beside + 1, here + 1))
    ]
    return vertices.astype(np.float32).astype(float), np.concatenate(faces)


def on_surface(soup, count, seed=0):
    """Return points spread over a soup of triangles (n, 3, 3)."""
    random = np.random.default_rng(seed)
    areas = np.linalg.norm(np.cross(soup[:, 1] - soup[:, 0], soup[:, 2] - soup[:, 0]), axis=1)
    which = random.choice(len(soup), count, p=areas / areas.sum())
    a, b = random.random((2, count, 1))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    one, two, three = (soup[which, corner] for corner in range(3))
    return one + a * (two - one) + b * (three - one)
