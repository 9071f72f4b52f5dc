"""The model of robot-path: a robot described by URDF moves among obstacles, without touching them or itself."""

from __future__ import annotations

import json
import math
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from problems.errors import did_you_mean
from problems.problem import Solution
from problems.robots.arm import PRISMATIC, Scene
from problems.robots.fields import GoalPose
from problems.robots.model import RobotModel
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.operators import Operator
    from problems.robot_path.coding import Clews, Paths

Configuration = Annotated[list[float], Field(min_length=1, max_length=64)]

_MARGIN = 0.002  # m
_MOST_ITEMS = 40  # of a genome: via points and the goal


class RobotPathModel(RobotModel):
    """The fields, coding, recipe, fitness and decoding; `RobotPath` adds what verifies and shows solutions."""

    about: ClassVar[str] = "a short path of a robot from a URDF among obstacles, proven on its meshes"
    template: ClassVar[str] = """\
kind = "robot-path"
start = [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785]   # rad (m for prismatic joints), in the order of the joints
goal = [1.2, 0.35, 0.1, -1.7, -0.1, 2.05, 0.6]          # or goals = [[..], [..]]: any of them
# unit = "deg"                    # of all angles in this file; "rad" if not given
# clearance = 0.01                # m, that every part of the robot keeps from everything

# [goal_pose]                     # in place of goal: any configuration that reaches it
# link = "panda_hand"
# position = [0.4, 0.1, 0.5]      # m
# quaternion = [1.0, 0.0, 0.0, 0.0]   # x, y, z, w; leave it out for the position only

[robot]
urdf = "example-robot-data:panda" # or a file, relative to this one
# srdf = "panda.srdf"             # pairs of links that may touch, groups of joints
# group = "panda_arm"             # of the SRDF
joints = [
    "panda_joint1", "panda_joint2", "panda_joint3", "panda_joint4", "panda_joint5", "panda_joint6", "panda_joint7",
]
fixed = { panda_finger_joint1 = 0.03, panda_finger_joint2 = 0.03 }

[[obstacles]]                     # a board between start and goal
id = "board"
shape = "box"                     # or "cylinder" with radius, length; "sphere" with radius; "mesh" with file
size = [0.5, 0.04, 0.5]           # m
position = [0.55, 0.25, 0.25]     # m

# [[attached]]                    # moves with a link; the same shapes
# link = "panda_hand"
# shape = "box"
# size = [0.05, 0.05, 0.2]        # m
# position = [0.0, 0.0, 0.2]      # m
# may_touch = ["panda_leftfinger", "panda_rightfinger"]

[run]                             # what the command line does not say
topology = "torus 1x2"
stall = 5
seed = 1
"""
    oracle_may_rule_out: ClassVar[bool] = False  # it is the straight line, which the search tries first
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    start: Configuration = quantity("rad", "where the robot stands; m for prismatic joints")
    goal: Configuration | None = quantity("rad", "where it is to go; m for prismatic joints", default=None)
    goals: list[Configuration] | None = quantity(
        "rad", "any of these is where it is to go; with goal_pose set by the program", default=None, max_length=64
    )
    goal_pose: GoalPose | None = quantity("", "a pose that a link is to reach, in place of goal", default=None)
    search: Literal["trees", "clew"] | None = quantity(
        "",
        "how paths are found: by trees whose paths are shortened, or by Ariadne's clew; if not given, the recipe's: "
        'tuned "trees", paper "clew"',
        default=None,
    )
    most_points: int = quantity(
        "", "the most points of a path between start and goal", default=_MOST_ITEMS, ge=2, le=256
    )

    @model_validator(mode="after")
    def _ends_fit_the_robot(self) -> Self:
        """Check numbers and limits; `RobotPath` checks contacts."""
        given = [name for name in ("goal", "goals", "goal_pose") if getattr(self, name) is not None]
        if given not in (["goal"], ["goals"], ["goals", "goal_pose"], ["goal_pose"]):
            if self.goal_pose is not None and self.goal is not None:
                given = ["goal", "goal_pose"]  # goals were derived from the pose
            raise ValueError(f"goal: expected one of goal, goals and goal_pose, found {' and '.join(given) or 'none'}")
        arm = self.scene.arm
        if self.goal_pose is not None and self.goal_pose.link not in arm.links:
            close = did_you_mean(self.goal_pose.link, arm.links)
            raise ValueError(f"goal_pose.link: expected a link of the URDF, found {self.goal_pose.link!r}{close}")
        if self.written_in == "deg" and PRISMATIC in arm.kinds[arm.variables >= 0]:
            raise ValueError('unit: expected "rad", as some joints of this robot slide, found "deg"')
        ends = {"start": self.start} | {f"goals[{number}]": goal for number, goal in enumerate(self.goals or [])}
        for name, values in (ends if self.goal is None else ends | {"goal": self.goal}).items():
            if len(values) != len(arm.joints):
                names = ", ".join(arm.joints)
                raise ValueError(f"{name}: expected {len(arm.joints)} values ({names}), found {len(values)}")
            for joint, value, (low, high) in zip(arm.joints, values, arm.limits, strict=True):
                if not low - 1e-9 <= value <= high + 1e-9:
                    raise ValueError(self._beyond(name, joint, value, (low, high)))
        stated = self.robot.acceleration
        if isinstance(stated, list) and len(stated) != len(arm.joints):
            raise ValueError(
                f"robot.acceleration: expected one value, or {len(arm.joints)} ({', '.join(arm.joints)}), "
                f"found {len(stated)}"
            )
        return self

    def _beyond(self, name: str, joint: str, value: float, limits: tuple[float, float]) -> str:
        """Return the complaint about a value beyond a joint's limits, in the unit of the file."""
        unit, factor = ("deg", math.degrees(1.0)) if self.written_in == "deg" else ("rad or m", 1.0)
        low, high, found = (factor * each for each in (*limits, value))
        return f"{name}: expected {joint} within [{low:.6g}, {high:.6g}] {unit}, found {found:.6g}"

    @classmethod
    def derive_from_scene(cls, fields: dict[str, Any], scene: Scene) -> dict[str, Any]:
        """Return the configurations that reach a goal pose."""
        return {} if fields.get("goal_pose") is None else _goals(fields, scene)

    @property
    def ends(self) -> list[list[float]]:
        """The goals, at least one."""
        return [self.goal] if self.goal is not None else list(self.goals or [])

    @property
    def solved_when(self) -> str:
        """Why no fitness counts as solved: paths get shorter as long as one waits."""
        return "paths get shorter as long as the run goes on; `supernode oracle` gives a bound of the length"

    @cached_property
    def coding(self) -> Paths | Clews:
        """The coding: via points and the index of the goal, or a clew."""
        from problems.robot_path.coding import Clews, Paths

        if self.search == "clew":
            return Clews(len(self.start), self._compiled)
        return Paths(len(self.start), self.most_points + 1, self._compiled)

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return the problem with a search: Ariadne's clew (paper), or trees whose paths are shortened (tuned)."""
        if self.search is not None:
            return self
        chosen = self.model_copy(update={"search": "trees" if name == "tuned" else "clew"})
        for cached in ("coding", "_compiled"):  # they depend on the search
            chosen.__dict__.pop(cached, None)
        return chosen

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the paper's operators; or those of trees, whose rate is how often a cell looks for another way."""
        if self.search == "clew":
            return Recipe("one-point", 1.0 / (2 * len(self.start) + 2), "offspring")
        return Recipe("joining", 0.25, "elitist", most_selections=0 if deme == 1 else 2)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the lengths of paths, rad, or 1000 plus the length that is not free: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"path": [[..], ..], "length": rad, "clearance": m}``; joints in m count as rad.

        ``clearance`` is at most what the path keeps from everything. A path that is not proven free has ``blocked`` in
        addition: the length of the segments that are not, or for a clew what is left, by a greater number.
        """
        from problems.robot_path import coding_kernels, kernels

        follow = coding_kernels.paper_kernels.follow if self.search == "clew" else kernels.follow
        genome, table = writable(genome), self._compiled.table
        path, blocked, clearance = kernels.measured(follow, genome, table, len(self.start))
        length = float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
        solution = {"path": path.tolist(), "length": length, "clearance": clearance}
        return solution | {"blocked": blocked} if blocked > 0.0 else solution

    def describe(self, solution: Solution) -> str:
        """Return the length, the clearance and the via points as text."""
        rows = ["  ".join(f"{value:8.4f}" for value in row) for row in solution["path"]]
        short = ", which is not free" if "blocked" in solution else ""
        return "\n".join([f"a path of {solution['length']:.4f} rad{short}, {len(rows)} points:", *rows])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, with the table that all kernels read; see `problems.robot_path.layout_kernels`."""
        from genetics.operators import Operator
        from problems.robot_path import coding_kernels, kernels
        from problems.robot_path.memo_kernels import new_memo

        limits = self.scene.arm.limits
        return Operator.of(
            coding_kernels.paper_kernels.evaluate if self.search == "clew" else kernels.evaluate,
            [len(self.start), self.most_points + 1],
            np.ascontiguousarray(limits.T),
            np.array([self.start, *self.ends], np.float64),
            new_memo(len(self.start)),
            *self.scene.with_clearance(self.clearance + self._margin).arrays(),
        )

    @cached_property
    def _margin(self) -> float:
        """The room that paths keep beside the clearance, m; less where the start or all goals are nearer to something.

        A proof takes the more tests the nearer a path comes to contact, and without a margin the shortest paths graze
        obstacles.
        """
        from problems.robot_path.coding_kernels import Collisions

        collisions = Collisions(self.scene)
        start, *goals = (collisions.gap(each, self.clearance + 2.0 * _MARGIN) for each in (self.start, *self.ends))
        return max(0.0, min(_MARGIN, 0.5 * (min(start, max(goals, default=0.0)) - self.clearance)))


def _goals(fields: dict[str, Any], scene: Scene) -> dict[str, Any]:
    """Return the field ``goals``: the free configurations that reach the goal pose."""
    from problems.robot_path.goals import reach

    try:
        pose = GoalPose.model_validate_json(json.dumps(fields["goal_pose"]), strict=True)
        start, clearance = np.array(fields.get("start"), np.float64), float(fields.get("clearance", 0.0))
    except (ValueError, TypeError):
        return {}  # validation reports it
    if start.shape != (len(scene.arm.joints),) or pose.link not in scene.arm.links:
        return {}
    return {"goals": reach(scene.with_clearance(clearance), start, pose).goals.tolist()}
