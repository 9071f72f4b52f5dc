"""Robots with masses as URDF texts, for tests of motions over time; they need no file."""

from problems.robots.fields import Robot

INERTIA = '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/>'


def link(name, mass=1.0, at="0.5 0 0", inertia=0.02, size="0.4 0.05 0.05"):
    shape = f'<collision><origin xyz="{at}"/><geometry><box size="{size}"/></geometry></collision>'
    if mass == 0.0:
        return f'<link name="{name}">{shape}</link>'
    inertial = f'<inertial><origin xyz="{at}"/><mass value="{mass}"/>{INERTIA.format(i=inertia)}</inertial>'
    return f'<link name="{name}">{inertial}{shape}</link>'


def joint(name, parent, child, kind="revolute", axis="0 1 0", at="0 0 0", more="", speed=2.0, effort=60.0):
    limit = f'<limit lower="-3" upper="3" velocity="{speed}" effort="{effort}"/>'
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>'
        f'<axis xyz="{axis}"/>{limit}{more}</joint>'
    )


def arm_urdf(mass=1.0, effort=60.0):
    """Two rods that swing about y on a carriage that slides along x, and a gripper of two fingers, one a mimic."""
    return (
        '<robot name="arm"><link name="world_link"/>'
        + link("carriage", mass, "0 0 0", size="0.1 0.1 0.1")
        + link("upper", mass)
        + link("lower", mass)
        + link("left", 0.1 * mass, "0.05 0.02 0", 1e-4, "0.1 0.01 0.01")
        + link("right", 0.1 * mass, "0.05 -0.02 0", 1e-4, "0.1 0.01 0.01")
        + joint("slide", "world_link", "carriage", "prismatic", "1 0 0", "0 0 0.5", speed=1.0, effort=300.0)
        + joint("shoulder", "carriage", "upper", effort=effort)
        + joint("elbow", "upper", "lower", at="1 0 0", effort=effort / 2.0)
        + joint("grip", "lower", "left", "prismatic", "0 1 0", "1 0 0", effort=20.0)
        + joint(
            "follow",
            "lower",
            "right",
            "prismatic",
            "0 -1 0",
            "1 0 0",
            '<mimic joint="grip" multiplier="1" offset="0.01"/>',
        )
        + "</robot>"
    )


JOINTS = ("slide", "shoulder", "elbow")
PATH = [[0.0, 1.2, 0.3], [0.4, 0.2, -1.0], [0.5, -0.8, -0.9], [-0.3, -1.0, 1.0]]


def arm(joints=JOINTS, **fields):
    mass, effort = fields.pop("mass", 1.0), fields.pop("effort", 60.0)
    return Robot(**({"urdf": arm_urdf(mass, effort), "joints": list(joints)} | fields))
