"""The model of arm-ik: joint angles that bring an arm's tip to a target, clear of obstacles and of itself."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Fitness, Genomes
from genetics.recipe import ONE_BIT, Recipe
from problems.planar_arm.model import ArmProblem, Configurations, Place
from problems.plane import Shapes
from problems.problem import Solution
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.bit_string import BitString
    from genetics.operators import Operator

MILLIMETRE = 1e-3
"""The distance to the target that counts as solved, m, if the code is fine enough for it."""

_FLIPS = 2.4  # mean number of bits that mutation flips per offspring (tuned): 0.15 per bit for two joints of 8 bits
_FLIPS_ON_ISLANDS = 4.0  # more, as islands lose diversity sooner: the best of a family takes the couple's place


class ArmIkModel(ArmProblem):
    """The fields, coding, recipe, fitness and decoding; `ArmIk` adds what verifies and shows solutions."""

    about: ClassVar[str] = "inverse kinematics of a planar arm among obstacles"
    template: ClassVar[str] = """\
kind = "arm-ik"
target = [1.2, 0.9]             # m, where the tip is to be
bits = 8                        # of each joint angle
# code = "gray"                 # or "binary"; if not given, the recipe's
# self_collision = true         # links that are not neighbours must not touch
# clearance = 0.02              # m, to obstacles and between links that are not neighbours; 0 if not given
# unit = "deg"                  # of all angles in this file; "rad" if not given

[arm]
links = [1.0, 0.8]              # m, from the base outwards
base = [0.0, 0.0]               # m
radius = 0.04                   # m, half the thickness of a link
# limits = [[-3.1, 3.1], [-2.6, 2.6]]   # rad, one pair a joint; full circles if not given

[[obstacles]]
shape = "circle"
center = [1.3, 0.2]             # m
radius = 0.25                   # m

[[obstacles]]
shape = "box"
center = [-0.2, 1.2]            # m
size = [0.8, 0.3]               # m
angle = 0.3                     # rad

[[obstacles]]
shape = "polygon"
vertices = [[-1.5, -0.4], [-0.8, -0.9], [-1.4, -1.3]]   # m

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    target: Place = quantity("m", "where the tip is to be, [x, y]")

    @cached_property
    def coding(self) -> BitString:
        """One integer for each joint (§3.1 step 1)."""
        from genetics.bit_string import BitString

        return BitString(len(self.arm.links), self.bits, gray=self.code != "binary")

    @property
    def code_step(self) -> float:
        """The displacement of the stretched arm's tip if every joint is off by half a code step, m.

        Every configuration has a coded one within half a step in each joint. So without obstacles, every reachable
        target has a coded configuration whose tip is at most this far away.
        """
        return self._sweep / self.steps / 2

    @cached_property
    def _sweep(self) -> float:
        """The distance that the stretched arm's tip travels if each joint turns through its whole range, m."""
        stretch_beyond = np.cumsum(self.arm.links[::-1])[::-1]
        return float(np.sum(stretch_beyond * self.joint_ranges[1]))

    @property
    def solved_at(self) -> float | None:
        """1 mm, or `code_step` if that is more, m; None if `code_step` is half of the arm's reach or more.

        With such a coarse code nearly any configuration would count as solved.
        """
        step = self.code_step
        return None if 2.0 * step >= sum(self.arm.links) else max(MILLIMETRE, step)

    @property
    def solved_when(self) -> str:
        """Which of the two distances `solved_at` is, and why."""
        step, share = self.code_step, self.code_step / sum(self.arm.links)
        coded = f"half a step of {self.bits} bits in each joint moves the stretched arm's tip by {step:.3g} m"
        if self.solved_at is None:
            return f"the code's step is too coarse for one: {coded}, {share:.0%} of its reach"
        if step < MILLIMETRE:
            return f"1 mm from the target, since the code's step is less: {coded}"
        bits = int(np.ceil(np.log2(self._sweep / (2 * MILLIMETRE) + 1)))
        return f"m from the target, the code's step: {coded}, {share:.1%} of its reach; {bits} bits allow 1 mm"

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the paper's operators (§3.1, §6), or the tuned ones: elitist, uniform crossover and more mutation.

        How the tuned ones were chosen: two links of 8 bits on an 8 × 8 torus found the discretised optimum in 91 % of
        random worlds with mutation 0.05 and one-point crossover, in 98.9 % with 0.1, and in 99.8 % with 0.15 and
        uniform crossover.
        """
        if name == "paper":
            return Recipe("one-point", ONE_BIT if deme > 1 else 1.0 / self.coding.length, "offspring")
        flips = _FLIPS if deme == 1 else _FLIPS_ON_ISLANDS
        return Recipe("uniform", min(0.5, flips / self.coding.length), "elitist")

    def configurations(self, integers: NDArray[np.int64]) -> Configurations:
        """Return the joint angles that coded integers stand for, rad: (n, links) to (n, links)."""
        from problems.arm_ik import kernels

        return kernels.configurations(np.require(integers, np.int64, ["C", "W"]), self._compiled.table)

    def angles(self, genomes: Genomes) -> Configurations:
        """Return the joint angles that genomes code, rad: (n, genome_bytes) to (n, links)."""
        return self.configurations(self.coding.integers(genomes))

    def distances(self, configurations: Configurations) -> Fitness:
        """Return the tip's distance to the target, m, or +inf in collision: (n, links), rad, to (n,)."""
        from problems.arm_ik import kernels

        return kernels.distances(np.require(configurations, np.float64, ["C", "W"]), self._compiled.table)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the `distances` of coded configurations: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code, for every combination of fields."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"configuration": [..], "tip": [x, y], "distance": d}``, in rad and m."""
        angles = self.angles(genome[None])[0]
        headings = np.cumsum(angles)
        tip = self.arm.base + np.array(self.arm.links) @ np.column_stack([np.cos(headings), np.sin(headings)])
        return {
            "configuration": angles.tolist(),
            "tip": tip.tolist(),
            "distance": float(np.hypot(*(tip - self.target))),
        }

    def describe(self, solution: Solution) -> str:
        """Return the place of the tip and the joint angles in words."""
        x, y = solution["tip"]
        angles = ", ".join(f"{angle:.4f}" for angle in solution["configuration"])
        return f"tip at ({x:.4f}, {y:.4f}) m, {solution['distance']:.4g} m from the target\njoints at {angles} rad"

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness as an operator. Its table, laid out as `problems.arm_ik.kernels` says, serves all kernels."""
        from genetics.operators import Operator
        from problems.arm_ik import kernels

        shapes = Shapes.of(self.obstacles)
        return Operator.of(
            kernels.evaluate,
            [self.bits, self.coding.gray, self.self_collision],
            np.array([self.arm.links, *self.joint_ranges]),
            [*self.arm.base, *self.target, self.reach_of_links, float(self.steps), self.apart],
            shapes.corners,
            shapes.starts,
            shapes.thickness,
            _bounding_boxes(shapes),
        )


def _bounding_boxes(shapes: Shapes) -> NDArray[np.float64]:
    """Return the left, lower, right and upper bound of each shape, m, shape (shapes, 4)."""
    boxes = np.empty((len(shapes.thickness), 4))
    for number, thickness in enumerate(shapes.thickness):
        corners = shapes.corners[shapes.starts[number] : shapes.starts[number + 1]]
        boxes[number] = [*(corners.min(axis=0) - thickness), *(corners.max(axis=0) + thickness)]
    return boxes
