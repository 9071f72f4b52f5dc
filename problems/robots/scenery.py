"""The frames of a robot's links over time, its shapes, and all that surrounds it, for viewers of its motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.motion import WORLD, Frame, Solid
from problems.robots.fields import Attached, MeshShape, Obstacle, Placed, Robot, Shape, name_of
from problems.robots.loading import shape_name
from problems.robots.meshes import decode_mesh, mesh_of
from problems.robots.urdf import Geometry, Joint, Urdf, read_urdf

Floats = NDArray[np.float64]


class Way(NamedTuple):
    """How a joint depends on the one that it follows, or on itself: ``multiplier * value + offset``."""

    joint: str
    multiplier: float
    offset: float


def way_of(urdf: Urdf, joint: Joint) -> Way:
    """Return the joint that moves this one, which is itself if it mimics none."""
    multiplier, offset = 1.0, 0.0
    while joint.mimic is not None:
        name, factor, shift = joint.mimic
        multiplier, offset = multiplier * factor, multiplier * shift + offset
        joint = urdf.joints[name]
    return Way(joint.name, multiplier, offset)


def standing(robot: Robot, urdf: Urdf, joint: str) -> float:
    """Return where a joint that is no variable stands, rad or m: as the file says, else at 0 or the nearest limit."""
    found = urdf.joints[joint]
    limits = found.limits if found.kind != "continuous" else None
    return robot.fixed.get(joint, 0.0 if limits is None else float(np.clip(0.0, *limits)))


def standing_joints(robot: Robot, joints: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """Return the names and values of the joints that could move, but stand still here."""
    urdf = read_urdf(robot.urdf)
    return tuple((name, standing(robot, urdf, name)) for name in urdf.movable if name not in joints)


def frames_over_time(robot: Robot, joints: Sequence[str], positions: Floats) -> tuple[Frame, ...]:
    """Return the frame of each link in that of the link before, the root's in the world.

    Args:
        robot: the robot, loaded.
        joints: the variables, in the order of configurations.
        positions: rad or m, shape (rows, n).
    """
    urdf = read_urdf(robot.urdf)
    base = robot.base.placement.reshape(3, 4)
    found = [Frame(WORLD, urdf.root, base[None, :, 3], quaternion_of(base[:, :3])[None])]
    for joint in urdf.joints.values():
        place = joint.placement.reshape(3, 4)
        turn = quaternion_of(place[:, :3])[None]
        if joint.kind not in ("revolute", "continuous", "prismatic"):
            found.append(Frame(joint.parent, joint.child, place[None, :, 3], turn))
            continue
        way = way_of(urdf, joint)
        values = np.array([standing(robot, urdf, way.joint)])
        if way.joint in joints:
            values = positions[:, list(joints).index(way.joint)]
        values = way.multiplier * values[:, None] + way.offset
        if joint.kind == "prismatic":
            places = place[:, 3] + values * (place[:, :3] @ joint.axis)
            found.append(Frame(joint.parent, joint.child, places, np.tile(turn, (len(values), 1))))
        else:
            turns = np.column_stack([np.sin(values / 2.0) * joint.axis, np.cos(values / 2.0)])
            places = np.tile(place[:, 3], (len(values), 1))
            found.append(Frame(joint.parent, joint.child, places, _times(turn[0], turns)))
    return tuple(found)


def solids_of(robot: Robot, obstacles: Sequence[Obstacle], attached: Sequence[Attached]) -> tuple[Solid, ...]:
    """Return the shapes of the links, of attached things and of obstacles, each in its frame."""
    return (
        *_of_links(robot),
        *(_of_table(robot, name_of(each, "attached", n), each.link, each) for n, each in enumerate(attached)),
        *(_of_table(robot, name_of(each, "obstacles", n), WORLD, each) for n, each in enumerate(obstacles)),
    )


def _of_links(robot: Robot) -> Iterator[Solid]:
    for link in read_urdf(robot.urdf).links.values():
        for number, shape in enumerate(link.collisions):
            place = shape.placement.reshape(3, 4)
            name = link.name if number == 0 else f"{link.name} {number + 1}"
            kind, size, triangles = _geometry(robot, shape)
            yield Solid(name, link.name, kind, size, place[:, 3], quaternion_of(place[:, :3]), triangles)


def _geometry(robot: Robot, shape: Geometry) -> tuple[str, tuple[float, ...], Floats | None]:
    """Return the kind, full lengths and triangles of a collision element; a capsule is shown as a cylinder."""
    match shape.shape:
        case "mesh":
            vertices, triangles = mesh_of(robot.meshes, shape.mesh, shape.scale)
            return "mesh", (), vertices[triangles]
        case "sphere":
            return "sphere", (2.0 * shape.size[0],) * 3, None
        case "box":
            return "box", shape.size, None
    radius, length = shape.size
    return "cylinder", (2.0 * radius, 2.0 * radius, length + (2.0 * radius if shape.shape == "capsule" else 0.0)), None


def _of_table(robot: Robot, name: str, frame: str, table: Shape) -> Solid:
    triangles = None
    if isinstance(table, MeshShape):
        x, y, z = table.scale
        vertices, faces = decode_mesh(robot.meshes[shape_name(table.file, (x, y, z))])
        triangles = vertices[faces]
    size = _lengths(table)
    return Solid(name, frame, table.shape, size, np.array(table.position), _unit(np.array(table.quaternion)), triangles)


def _lengths(table: Placed) -> tuple[float, ...]:
    """Return the full lengths of a box, cylinder or sphere along its axes."""
    match getattr(table, "shape", ""):
        case "box":
            return tuple(getattr(table, "size", ()))
        case "cylinder":
            across = 2.0 * getattr(table, "radius", 0.0)
            return (across, across, getattr(table, "length", 0.0))
        case "sphere":
            return (2.0 * getattr(table, "radius", 0.0),) * 3
    return ()


# Quaternions x, y, z, w -----------------------------------------------------------------------------------------------
def quaternion_of(rotation: Floats) -> Floats:
    """Return the quaternion x, y, z, w of a rotation matrix: the eigenvector of Bar-Itzhack's matrix (JGCD 2000)."""
    r = rotation
    matrix = np.array(
        [
            [r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0], r[2, 1] - r[1, 2]],
            [r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1], r[0, 2] - r[2, 0]],
            [r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1], r[0, 0] + r[1, 1] + r[2, 2]],
        ]
    )
    found: Floats = np.linalg.eigh(matrix)[1][:, -1]
    return -found if found[3] < 0.0 else found


def _unit(quaternion: Floats) -> Floats:
    unit: Floats = quaternion / np.linalg.norm(quaternion)
    return unit


def _times(one: Floats, others: Floats) -> Floats:
    """Return the products of a quaternion with others: (4,) and (m, 4) to (m, 4)."""
    turn, whole = one[:3], one[3]
    turns, wholes = others[:, :3], others[:, 3:]
    mixed = whole * turns + wholes * turn + np.cross(turn, turns)
    return np.column_stack([mixed, whole * wholes[:, 0] - turns @ turn])
