"""The model of min-time: in how little time can an arm go from rest to rest within the limits of its joints?"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from problems.angles import Angle, WithAngles
from problems.errors import BadInput, shorten
from problems.min_time.arm import LIMITS, Arm
from problems.problem import Solution
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from pathlib import Path

    from genetics.operators import Operator
    from problems.min_time.coding import Trajectories

_NODES_A_STEP = 5  # a trajectory has at most so many nodes for each step of the grid


class MinTimeModel(WithAngles):
    """The fields, coding, recipe, fitness and decoding; `MinTime` adds what verifies and shows solutions."""

    about: ClassVar[str] = (
        "minimum-time trajectories of an arm within limits of torque, velocity, acceleration and jerk"
    )
    template: ClassVar[str] = """\
kind = "min-time"
# unit = "deg"                  # of all angles in this file, and of speeds, in degrees per second; "rad" if not given
start = [-0.5, -1.0]            # rad, one angle a joint; at rest
goal = [0.5, 1.0]               # rad; at rest again
grid = 10                       # lines of the grid in each joint, between start and goal
# free = true                   # nodes anywhere between start and goal, not only on the grid
radius = 0.25                   # within which trajectories are crossed, the grid being a unit square
# profile = "coded"             # torque levels are searched for too; or "optimal": full torque; else the recipe's

[arm]                           # uniform rods in a plane
masses = [1.0, 1.0]             # kg
lengths = [1.0, 1.0]            # m
tip_mass = 1.0                  # kg
gravity = 0.0                   # m/s², along -y
torque = [64.5, 64.5]           # N m, limits
# velocity = [2.0, 2.0]         # rad/s, limits; without them none for rods, and those of a URDF
# acceleration = [8.0, 8.0]     # rad/s², limits, if there are any
# jerk = [60.0, 60.0]           # rad/s³, limits, if there are any
# urdf = "robot.urdf"           # instead of masses and lengths; needs supernode[dynamics]
# joints = ["joint_1", ..]      # of the URDF, those that move

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
stall = 50                      # generations without a quicker one, after which it ends
"""
    oracle_decides: ClassVar[bool] = False  # the oracle knows only paths along the grid; others may be quicker
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    start: list[Angle] = quantity("rad", "where the arm starts from rest, one angle a joint", min_length=1)
    goal: list[Angle] = quantity("rad", "where it comes to rest", min_length=1)
    grid: int = quantity("", "lines of the grid in each joint, the first at start and the last at goal", default=10,
                         ge=2, le=1000)  # fmt: skip
    free: bool = quantity("", "whether nodes may be anywhere in the box between start and goal", default=False)
    radius: float = quantity(
        "", "how near nodes must be for two trajectories to cross there, in the box scaled to the unit square",
        default=0.25, ge=0, le=100,
    )  # fmt: skip
    profile: Literal["coded", "optimal"] | None = quantity(
        "",
        'torque levels of the stretches: "coded" in the genome, or "optimal": always the full torque; if not given, '
        'the recipe\'s: tuned "optimal", paper "coded"',
        default=None,
    )
    arm: Arm = quantity("", "the arm")

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Replace the URDF's name with its bodies and its limits of torque and velocity; limits in the file win."""
        arm = fields.get("arm")
        if not (isinstance(arm, dict) and isinstance(arm.get("urdf"), str)):
            return fields
        from problems.min_time import urdf

        joints = arm.get("joints")
        if not (joints is None or (isinstance(joints, list) and all(isinstance(name, str) for name in joints))):
            raise BadInput(f"arm.joints: expected a list of names, found {shorten(joints)}")
        read = urdf.read(arm["urdf"], joints, folder, arm)
        # What the file states comes last, so that its limits replace the URDF's.
        rest = {name: value for name, value in arm.items() if name not in ("urdf", "joints")}
        return fields | {"arm": read | rest}

    @model_validator(mode="after")
    def _can_stand_at_both_ends(self) -> Self:
        limits = self.arm.limit_of("torque")
        for name, angles in (("start", self.start), ("goal", self.goal)):
            if len(angles) != self.arm.size:
                raise ValueError(f"{name}: expected {self.arm.size} angles, found {len(angles)}")
            for angle, body in zip(angles, self.arm.chain, strict=True):
                if body.limits is not None and not body.limits[0] <= angle <= body.limits[1]:
                    raise ValueError(f"{name}: expected {body.name} within {list(body.limits)}, found {angle:g}")
            # An arm that cannot hold still at an end cannot be at rest there, so every trajectory would be infeasible.
            load = self.arm.holding_torque(angles)
            for joint in np.flatnonzero(np.abs(load) > limits):
                raise ValueError(
                    f"{name}: expected a place that the arm can hold, found {load[joint]:g} N m needed at "
                    f"{self.arm.names[joint]}, more than its limit {limits[joint]:g}"
                )
        return self

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return the problem with a profile: levels in the genome (paper) or always full torque (tuned).

        Less torque never makes a given curve faster, so tuned does not search for levels.
        """
        if self.profile is not None:
            return self
        profile = "optimal" if name == "tuned" else "coded"
        return self.model_validate(self.model_dump(exclude_unset=True) | {"profile": profile})

    @cached_property
    def coding(self) -> Trajectories:
        """The coding {α_11, .., α_m1, s_1; ..; α_1n, .., α_mn, s_n} (§III)."""
        from problems.min_time.coding import Trajectories

        # A joint whose start is its goal has a single place: it does not move at all, since the curve stays in the box.
        steps = [self.grid - 1 if start != goal else 0 for start, goal in zip(self.start, self.goal, strict=True)]
        most = max(2, _NODES_A_STEP * (self.grid - 1))
        return Trajectories(steps, most, self.radius, self.free, full_torque=self.profile != "coded")

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the recipe of §IV and §V (paper), or refinement in small steps that never loses the best (tuned)."""
        if name == "paper":
            # On an island offspring replace all parents, and no trajectory is selected more than twice (§IV).
            return Recipe("analogous", 0.3, "offspring", renewal=None if deme == 1 else 1.0, most_selections=2)
        return Recipe("refining", 0.3, "elitist", most_selections=0 if deme == 1 else 2)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the travel times, s, +inf if the limits forbid the curve: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code."""
        return self._compiled

    def inverse_dynamics(self, genomes: Genomes) -> int:
        """Return how many evaluations of the inverse dynamics `evaluate` makes for genomes, (n, genome_bytes).

        The benchmarks compare it with the count of the tree search.
        """
        from problems.min_time.kernels import points_of

        # The first number of a genome is its number of nodes: one for each stretch.
        stretches = writable(genomes).view(np.uint16)[:, 0]
        return int(sum(count * points_of(count) + 1 for count in stretches.tolist()))

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"time": s, "nodes": [[..], ..], "trajectory": {"t": [..], "q": [[..]], "qd", "qdd", "torque"}}``.

        Without a limit of jerk the rows are equally spaced along the curve, with the same number on each stretch.
        Between two rows the second derivative of the curve's parameter s by time is linear in s. Accelerations and
        torques of a row are those at the beginning of the step that begins there. With a limit of jerk the rows are
        equally spaced in time, that derivative is linear in time, and ``trajectory`` also has ``place``, each row's s.
        """
        from problems.min_time import kernels

        nodes, rows = kernels.follow(writable(genome), self._compiled.table)
        names = ("q", "qd", "qdd", "torque")
        columns = {name: rows[:, 1 + place].tolist() for place, name in enumerate(names)}
        if self.arm.jerk is not None:
            columns["place"] = rows[:, 5, 0].tolist()
        time = rows[:, 0, 0].tolist()
        return {"time": time[-1], "nodes": nodes.tolist(), "trajectory": {"t": time} | columns}

    def describe(self, solution: Solution) -> str:
        """Return a text with the time, the nodes, and how near each joint comes to its limits."""
        nodes = " → ".join("(" + ", ".join(f"{angle:.3f}" for angle in node) + ")" for node in solution["nodes"])
        lines = [f"{solution['time']:.4f} s by nodes {nodes} rad"]
        for name, column in (("torque", "torque"), ("velocity", "qd"), ("acceleration", "qdd")):
            limits = self.arm.limit_of(name)
            if np.isfinite(limits).all():
                greatest = np.abs(solution["trajectory"][column]).max(axis=0) / limits
                lines.append(
                    f"greatest {name}: " + ", ".join(f"{100 * share:.0f} %" for share in greatest) + " of limits"
                )
            elif name == "velocity":
                lines.append("velocity is not limited: state `velocity` of the arm")
        return "\n".join(lines)

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, with the table that all kernels read; `problems.min_time.kernels` names its parts."""
        from genetics.operators import Operator
        from problems.min_time import kernels

        arm, coding = self.arm, self.coding
        # Two rods have closed-form dynamics.
        is_chain = not (arm.is_planar and arm.size == 2)
        return Operator.of(
            kernels.evaluate,
            [arm.size, coding.most, is_chain, arm.acceleration is not None, arm.jerk is not None],
            list(coding.greatest),
            np.array([self.start, self.goal, *(arm.limit_of(name) for name in LIMITS)]),
            np.zeros(5) if is_chain else arm.two_links,
            arm.rows,
            arm.falling,
        )
