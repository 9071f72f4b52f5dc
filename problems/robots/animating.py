"""Animations of robots: the bodies of a robot and its scene at modest detail, and the ways of its tips."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from problems.animation import WORLD, Body, Role, coarsened, joined, placed
from problems.robots.arm import Arm
from problems.robots.chain import frames_of
from problems.robots.fields import (
    Attached,
    Box,
    Cylinder,
    GoalPose,
    MeshShape,
    Obstacle,
    Robot,
    Shape,
    Sphere,
    name_of,
    rotation_of,
)
from problems.robots.loading import shape_name
from problems.robots.meshes import UNSCALED, Scale, decode_mesh, mesh_text
from problems.robots.shapes import chained, primitive
from problems.robots.urdf import Geometry, read_urdf

Floats = NDArray[np.float64]

MOST_TRIANGLES = 900
"""The most triangles of one mesh; a robot has about ten."""


def bodies_of(robot: Robot, arm: Arm, obstacles: Sequence[Obstacle], attached: Sequence[Attached]) -> tuple[Body, ...]:
    """Return the robot's links, the attached things and the obstacles; the frames are those of `Arm`'s bodies."""
    return (*_links(robot, arm), *_attached(robot, arm, attached), *obstacles_of(robot, obstacles))


def _links(robot: Robot, arm: Arm) -> Iterator[Body]:
    for link in read_urdf(robot.urdf).links.values():
        if not link.collisions:
            continue
        at = arm.links.index(link.name)
        parts = [placed(chained(arm.link_placements[at], each.placement), _geometry(robot, each))
                 for each in link.collisions]  # fmt: skip
        yield _body(link.name, "robot", int(arm.link_body[at]), np.concatenate(parts))


def _attached(robot: Robot, arm: Arm, attached: Sequence[Attached]) -> Iterator[Body]:
    for number, thing in enumerate(attached):
        at = arm.links.index(thing.link)
        soup = placed(chained(arm.link_placements[at], thing.placement), _shape(robot, thing))
        yield _body(name_of(thing, "attached", number), "attached", int(arm.link_body[at]), soup)


def obstacles_of(robot: Robot, obstacles: Sequence[Obstacle]) -> tuple[Body, ...]:
    """Return the obstacles in the order of the file; their frame is that of the world."""
    return tuple(_obstacles(robot, obstacles))


def _obstacles(robot: Robot, obstacles: Sequence[Obstacle]) -> Iterator[Body]:
    for number, obstacle in enumerate(obstacles):
        soup = placed(obstacle.placement, _shape(robot, obstacle))
        yield _body(name_of(obstacle, "obstacles", number), "obstacle", WORLD, soup)


def _body(name: str, role: Role, frame: int, soup: Floats) -> Body:
    return Body.of_soup(name, role, frame, soup.reshape(-1, 3, 3))


def _geometry(robot: Robot, geometry: Geometry) -> Floats:
    """Return the corners of the triangles of a collision element, shape (3 T, 3)."""
    if geometry.shape == "mesh":
        return _mesh(robot, geometry.mesh, geometry.scale)
    return primitive(geometry.shape, geometry.size).reshape(-1, 3)


def _shape(robot: Robot, shape: Shape) -> Floats:
    """Return the corners of the triangles of an obstacle or attached thing, shape (3 T, 3)."""
    match shape:
        case Box():
            soup = primitive("box", shape.size)
        case Cylinder():
            soup = primitive("cylinder", (shape.radius, shape.length))
        case Sphere():
            soup = primitive("sphere", (shape.radius,))
        case MeshShape():
            x, y, z = shape.scale
            return _mesh(robot, shape_name(shape.file, (x, y, z)), UNSCALED)
    return soup.reshape(-1, 3)


def _mesh(robot: Robot, name: str, scale: Scale) -> Floats:
    return _coarse(mesh_text(robot.meshes, name, scale))


@lru_cache(maxsize=128)  # a page asks again for each better solution
def _coarse(text: str) -> Floats:
    vertices, triangles = decode_mesh(text)
    vertices, triangles = coarsened(*joined(vertices[triangles]), MOST_TRIANGLES)
    corners: Floats = vertices[triangles].reshape(-1, 3)
    corners.setflags(write=False)
    return corners


def places_of(arm: Arm, configurations: Floats) -> Floats:
    """Return the placement of each body of a robot: configurations (N, n) to (N, B, 12)."""
    return frames_of(arm, configurations)


def target_of(pose: GoalPose) -> Floats:
    """Return a pose as a placement, shape (12,); with the world's axes if any rotation will do."""
    turn = np.eye(3) if pose.quaternion is None else rotation_of(pose.quaternion)
    placement: Floats = np.column_stack([turn, pose.position]).reshape(12)
    return placement


def ways_of(arm: Arm, frames: Floats, link: str | None = None) -> tuple[Floats, ...]:
    """Return the ways of a robot's tips, m, shape (N, 3) each.

    Args:
        arm: the robot.
        frames: the placements of its bodies at each step, shape (N, B, 12).
        link: see `tips_of`.
    """
    numbers = [arm.links.index(tip) for tip in tips_of(arm, link)]
    return tuple(
        placed(frames[:, arm.link_body[each]], arm.link_placements[each].reshape(3, 4)[None, :, 3])[:, 0]
        for each in numbers
    )


def tips_of(arm: Arm, link: str | None = None) -> tuple[str, ...]:
    """Return the tips of a robot: the last link beyond the last joint of each branch.

    Args:
        arm: the robot.
        link: a link that stands for the tips of the branches to which it belongs.
    """
    named = None if link is None else int(arm.link_body[arm.links.index(link)])
    ends = sorted(set(range(1, len(arm.parents))) - set(arm.parents.tolist()))
    tips = [arm.links[int(np.flatnonzero(arm.link_body == end)[-1])] for end in ends if named not in _line(arm, end)]
    return tuple(tips) if link is None else (link, *tips)


def _line(arm: Arm, body: int) -> list[int]:
    """Return a body and those that carry it, without the world."""
    return [] if body <= 0 else [body, *_line(arm, int(arm.parents[body]))]
