"""The compiled fitness of coded arm configurations: forward kinematics, then collisions.

Arrays are allocated once per call, not once per configuration.

The table of an operator (see `genetics.operators`) holds, by place:

0. the bits of each angle, whether they are in Gray code, whether the arm must not touch itself;
1. link lengths (m), lowest angles and widths of the ranges (rad), shape (3, links);
2. base x, y and target x, y (m), the radius of a link plus clearance (m), the code steps in a range, and the least
   distance between the axes of links that are not neighbours (m);
3. and up: the three fields of `problems.planar_arm.kernels.Obstacles`, and their bounding boxes.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.bit_kernels import integers_of
from genetics.operators import FITNESS, Table
from lowlevel.compiled import kernel, subroutine
from lowlevel.pointers import integers, reals
from problems.planar_arm.kernels import Arm, Obstacles, link_hits, place, touches_itself

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


class Task(NamedTuple):
    """What a fitness depends on, besides the angles."""

    arm: Any
    target: Any  # (2,), m
    obstacles: Any
    boxes: Any  # (shapes, 4), m: x0, y0, x1, y1 of each obstacle


@subroutine
def _task_of(table: Any) -> Any:
    self_collision, lengths, places = integers(table, 0)[0, 2] != 0, reals(table, 1)[0], reals(table, 2)[0]
    arm = Arm(lengths, places[:2], places[4], places[6], self_collision)
    obstacles = Obstacles(reals(table, 3), integers(table, 4)[0], reals(table, 5)[0])
    return Task(arm, places[2:4], obstacles, reals(table, 6))


@subroutine
def _turn(codes: Any, table: Any, angles: Any) -> Any:
    """Fill ``angles``, rad, with those that coded integers stand for; both have the shape (links,)."""
    joints, steps = reals(table, 1), reals(table, 2)[0, 5]
    for joint in range(codes.size):
        angles[joint] = joints[1, joint] + joints[2, joint] * codes[joint] / steps


@subroutine
def _distance(angles: Any, task: Any, joints: Any) -> Any:
    """Return f(θ) of §3.1: the tip's distance to the target, m, or +inf in collision.

    ``joints`` is working memory for `place`; its first row must be the base.
    """
    arm = task.arm
    place(joints, angles, arm.lengths)
    if arm.self_collision and touches_itself(joints, arm.apart):
        return np.inf
    for link in range(arm.lengths.size):
        ax, ay, bx, by = joints[link, 0], joints[link, 1], joints[link + 1, 0], joints[link + 1, 1]
        if link_hits(ax, ay, bx, by, arm.radius, task.obstacles, task.boxes):
            return np.inf
    return np.hypot(joints[-1, 0] - task.target[0], joints[-1, 1] - task.target[1])


@subroutine
def _joints_of(arm: Any) -> Any:
    """Return working memory for `place`."""
    joints = np.empty((arm.lengths.size + 1, 2))
    joints[0] = arm.base
    return joints


@kernel(FITNESS, may_be_long=True)
def evaluate(genomes: Genomes, fitness: Fitness, table: Table) -> None:
    """Compute f(θ) of §3.1, m, for coded configurations."""
    layout, task = integers(table, 0)[0], _task_of(table)
    links, joints = task.arm.lengths.size, _joints_of(task.arm)
    codes, angles = np.empty(links, np.int64), np.empty(links)
    for row in range(fitness.size):
        integers_of(genomes[row], layout[0], layout[1] != 0, codes)
        _turn(codes, table, angles)
        fitness[row] = _distance(angles, task, joints)


@kernel("float64[::1](float64[:,::1], int64[:,::1])")
def distances(configurations: Floats, table: Table) -> Fitness:
    """Return f(θ) of §3.1, m, for joint angles, rad: (n, links) to (n,)."""
    task = _task_of(table)
    joints = _joints_of(task.arm)
    fitness = np.empty(configurations.shape[0])
    for row in range(fitness.size):
        fitness[row] = _distance(configurations[row], task, joints)
    return fitness


@kernel("float64[:,::1](int64[:,::1], int64[:,::1])")
def configurations(codes: Integers, table: Table) -> Floats:
    """Return the joint angles, rad, that coded integers stand for: (n, links) to (n, links)."""
    angles = np.empty(codes.shape)
    for row in range(codes.shape[0]):
        _turn(codes[row], table, angles[row])
    return angles
