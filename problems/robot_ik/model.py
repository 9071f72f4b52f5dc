"""The model of robot-ik: configurations of a robot, described by URDF, that bring one of its links to a pose."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from problems.problem import Solution
from problems.robots.arm import REVOLUTE, Scene
from problems.robots.fields import GoalPose, rotation_of
from problems.robots.model import RobotModel
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.operators import Operator
    from genetics.real_vector import RealVector

Floats = NDArray[np.float64]


class RobotIkModel(RobotModel):
    """The fields, coding, recipe, fitness and decoding; `RobotIk` adds what verifies and shows solutions."""

    about: ClassVar[str] = "inverse kinematics of a robot from a URDF, clear of obstacles and of itself"
    template: ClassVar[str] = """\
kind = "robot-ik"
# solutions = 4                   # how many different ones are wanted; 1 if not given
# clearance = 0.01                # m, that every part of the robot keeps from everything
# self_collision = false          # the robot may touch itself; it may not if not given
# unit = "deg"                    # of all angles in this file; "rad" if not given

[goal_pose]
link = "panda_hand"               # the link whose frame is to reach the pose
position = [0.45, 0.2, 0.4]       # m
quaternion = [1.0, 0.0, 0.0, 0.0] # x, y, z, w; leave it out for the position only
# position_tolerance = 1e-4       # m
# angle_tolerance = 1e-3          # rad

[robot]
urdf = "example-robot-data:panda" # or a file, relative to this one
# srdf = "panda.srdf"             # pairs of links that may touch, groups of joints
group = "arm"                     # of the SRDF; or joints = [".."], which move; all if not given
fixed = { panda_finger_joint1 = 0.03 }   # others; 0, or the nearest limit if not given

[[obstacles]]
id = "board"
shape = "box"                     # or "cylinder" with radius, length; "sphere" with radius; "mesh" with file
size = [0.4, 0.4, 0.04]           # m
position = [0.5, 0.2, 0.2]        # m

# [[attached]]                    # moves with a link; the same shapes
# link = "panda_hand"
# shape = "box"
# size = [0.05, 0.05, 0.2]        # m
# position = [0.0, 0.0, 0.2]      # m
# may_touch = ["panda_leftfinger", "panda_rightfinger"]

[run]                             # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    oracle_decides: ClassVar[bool] = False  # it is a local solver, for comparison
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    goal_pose: GoalPose = quantity("", "the pose that a link is to reach")
    solutions: int = quantity("", "how many different configurations are wanted", default=1, ge=1, le=64)
    apart: float = quantity(
        "",
        "how much the joint that differs most must differ between two solutions, rad (m for prismatic joints); angles "
        "that differ by whole turns are the same",
        default=0.1,
        ge=1e-3,
        le=3.0,
    )
    self_collision: bool = quantity("", "whether the robot must not touch itself", default=True)
    steps: int = quantity("", "the most steps of damped least squares on each configuration", default=40, ge=0, le=1000)

    @model_validator(mode="after")
    def _can_move_the_link(self) -> Self:
        try:
            arm = self.scene.arm
        except ValueError as error:
            raise ValueError(f"model: {error}") from None
        try:
            body, _ = arm.link(self.goal_pose.link)
        except KeyError:
            links = ", ".join(arm.links)
            raise ValueError(f"goal_pose.link: expected one of {links}, found {self.goal_pose.link!r}") from None
        if body == 0:
            raise ValueError(
                f"goal_pose.link: expected a link that the joints move, found {self.goal_pose.link!r}, which stands "
                "still; choose others by robot.joints or robot.group"
            )
        return self

    @cached_property
    def coding(self) -> RealVector:
        """A share, from 0 to 1, of the range of each joint, for each solution."""
        from genetics.real_vector import RealVector

        return RealVector(self.solutions * len(self.scene.arm.joints), 0.0, 1.0)

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return blend crossover; the tuned recipe keeps the best and mutates about two joints of an offspring."""
        if name == "paper":
            return Recipe("blend", 0.1, "offspring")
        return Recipe("blend", min(0.5, 2.0 / self.coding.dimension), "elitist")

    @property
    def solved_at(self) -> float:
        """1: all solutions are there, within the tolerances."""
        return 1.0

    @property
    def solved_when(self) -> str:
        """The meaning of `solved_at`, in words."""
        pose = self.goal_pose
        turned = "" if pose.quaternion is None else f" and {pose.angle_tolerance:g} rad"
        each = "the pose is" if self.solutions == 1 else f"{self.solutions} different configurations are"
        return f"{each} within {pose.position_tolerance:g} m{turned}, and nothing touches"

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the errors as multiples of the tolerances, see `problems.robot_ik.kernels.evaluate`: to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"configuration": [..], "position_error": m, "angle_error": rad, "clearance": m}``.

        ``clearance`` is a lower bound of the least distance, at most 1 m; one that is not above the problem's clearance
        says that the configuration is not known to keep it. If more than one solution is wanted, ``others`` lists the
        further ones, and the three figures are the worst of all.
        """
        from problems.robot_ik import kernels

        found, known = kernels.follow(writable(genome).view(np.float64), self._compiled.table)
        counts = known[:, 4] != 0.0
        if not counts.any():  # none is a solution: the one that comes nearest stands for all
            counts[np.argmin(self._fitness_of_each(known))] = True
        found, known = found[counts], known[counts]
        solution = {
            "configuration": found[0].tolist(),
            "position_error": float(known[:, 0].max()),
            "angle_error": float(known[:, 1].max()),
            "clearance": float(min(map(self._claimed, known[:, 2], known[:, 3]))),
        }
        return solution if self.solutions == 1 else solution | {"others": found[1:].tolist()}

    def _fitness_of_each(self, known: Floats) -> Floats:
        from problems.robot_ik.kernels import CONTACT

        pose = self.goal_pose
        errors = known[:, 0] / pose.position_tolerance
        if pose.quaternion is not None:
            errors = np.maximum(errors, known[:, 1] / pose.angle_tolerance)
        each: Floats = errors + CONTACT * (known[:, 3] == 0.0)
        return each

    def _claimed(self, gap: float, is_free: float) -> float:
        """Return the clearance to state: above the problem's if and only if the test says that it is kept."""
        # Test and measurement may differ in the last bits.
        return max(gap, float(np.nextafter(self.clearance, np.inf))) if is_free else min(gap, self.clearance)

    def describe(self, solution: Solution) -> str:
        """Return the errors, the clearance and the configurations as text."""
        several = [solution["configuration"], *solution.get("others", [])]
        rows = ["  ".join(f"{value:9.5f}" for value in each) for each in several]
        wanted = "" if self.solutions == 1 else f"{len(several)} of {self.solutions} solutions, "
        head = f"{wanted}{solution['position_error']:.2g} m and {solution['angle_error']:.2g} rad from the pose"
        return "\n".join([f"{head}, {solution['clearance']:.4f} m clear; {', '.join(self.scene.arm.joints)}:", *rows])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, with the table that `problems.robot_ik.kernels` describes."""
        from genetics.operators import Operator
        from problems.robot_ik import kernels

        scene, pose = self._tested, self.goal_pose
        arm = scene.arm
        body, offset = arm.link(pose.link)
        turns = pose.quaternion is not None
        low, high = arm.limits.T
        angles = np.isin(np.arange(len(arm.joints)), arm.variables[arm.kinds == REVOLUTE])
        return Operator.of(
            kernels.evaluate,
            [len(arm.joints), self.solutions, self.steps, body, turns, bool(len(scene.solids) or len(arm.pairs))],
            np.array([low, high - low, angles.astype(float)]),
            [pose.position_tolerance, pose.angle_tolerance, self.apart],
            np.array([offset, pose_of(pose)]),
            *scene.arrays(),
        )

    @cached_property
    def _tested(self) -> Scene:
        """The scene without pairs of the robot's own links if these may touch."""
        from dataclasses import replace

        scene = self.scene
        if self.self_collision:
            return scene
        own = np.isin(np.array(scene.arm.pieces), scene.arm.links)[scene.arm.pairs].all(axis=1)
        return replace(scene, arm=replace(scene.arm, pairs=scene.arm.pairs[~own]))


def pose_of(target: GoalPose) -> Floats:
    """Return the pose as a row-major 3×4 matrix, shape (12,); with the world's axes if any rotation will do."""
    turn = np.eye(3) if target.quaternion is None else rotation_of(target.quaternion)
    pose: Floats = np.column_stack([turn, target.position]).reshape(12)
    return pose
