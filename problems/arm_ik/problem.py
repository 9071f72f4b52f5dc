"""The arm-ik planner: which joint angles bring an arm's tip to a target, clear of obstacles and of itself?"""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from genetics.arrays import Fitness, Genomes
from genetics.recipe import ONE_BIT, Recipe
from problems.angles import Angle, WithAngles
from problems.arm_ik import checker, reach
from problems.plane import Metres, Obstacle, Shapes
from problems.problem import Answer, CodedProblem, Populations, RecipeName, Solution, Table, Verdict, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from genetics.bit_string import BitString
    from genetics.operators import Operator

Length = Annotated[float, Field(gt=0, le=1e6)]
Place = tuple[Metres, Metres]
Configurations = NDArray[np.float64]  # (n, links), rad

MILLIMETRE = 1e-3
"""How near to its target a tip has to come at least, m, however fine the code."""

_FLIPS = 2.4  # bits changed in an offspring, on average, by the tuned recipe: 0.15 a bit for two joints of 8 bits
_FLIPS_ON_ISLANDS = 4.0  # which lose their diversity sooner, as the best of a family replaces all of it


class Arm(Table):
    """A planar arm of revolute joints; joint angle j is relative to link j − 1, all zero points along +x."""

    links: list[Length] = quantity("m", "lengths from the base outwards, at least one", min_length=1, max_length=100)
    base: Place = quantity("m", "where the first joint stands", default=(0.0, 0.0))
    radius: float = quantity("m", "half the thickness of a link", default=0.0, ge=0, le=1e6)
    limits: list[tuple[Angle, Angle]] | None = quantity(
        "rad", "[lowest, highest] angle of each joint; a full circle [0, 2π) if not given", default=None
    )

    @field_validator("limits")
    @classmethod
    def _one_pair_a_link(
        cls, limits: list[tuple[float, float]] | None, info: ValidationInfo
    ) -> list[tuple[float, float]] | None:
        links = len(info.data.get("links", limits or []))
        if limits is not None and len(limits) != links:
            raise ValueError(f"expected one [lowest, highest] for each of {links} links, found {len(limits)}")
        for joint, (lowest, highest) in enumerate(limits or []):
            if not lowest < highest:
                raise ValueError(f"expected lowest < highest for joint {joint + 1}, found [{lowest}, {highest}]")
        return limits


class ArmProblem(CodedProblem, WithAngles):
    """What all problems of planar arms among obstacles share."""

    bits: int = quantity("bit", "bits of each joint angle", default=8, ge=1, le=62)
    clearance: float = quantity(
        "m",
        "what links keep at least from obstacles, and from links that are not their neighbours",
        default=0.0,
        ge=0,
        le=1e6,
    )
    self_collision: bool = quantity("", "whether links that are not neighbours must not touch each other", default=True)
    arm: Arm = quantity("", "the arm")
    obstacles: list[Obstacle] = quantity("", "solid shapes that no link may touch", default_factory=list)

    @model_validator(mode="after")
    def _some_configuration_may_be_free(self) -> Self:
        hit = checker.obstacle_at_base(self)
        if hit is not None:
            raise ValueError(
                f"arm.base: expected a place clear of the obstacles by the arm's radius {self.arm.radius:g}"
                f"{self._and_clearance}, found {list(self.arm.base)} in obstacles[{hit}]"
            )
        shortest = min(self.arm.links[1:-1], default=np.inf)
        if self.self_collision and shortest < self.apart:
            raise ValueError(
                f"arm.links: expected links between others at least twice the radius {self.arm.radius:g}"
                f"{self._and_clearance} long, else these would always touch, found {shortest:g}"
            )
        return self

    @property
    def _and_clearance(self) -> str:
        return f" and the clearance {self.clearance:g}" if self.clearance else ""

    @property
    def reach_of_links(self) -> float:
        """How far obstacles have to be from the axis of a link, m: half its thickness, and the clearance."""
        return self.arm.radius + self.clearance

    @property
    def apart(self) -> float:
        """How far the axes of links that are no neighbours have to be from each other, m."""
        return 2.0 * self.arm.radius + self.clearance

    @cached_property
    def joint_ranges(self) -> tuple[Configurations, Configurations]:
        """The lowest angle of each joint and its range, rad, shape (links,) each."""
        limits = np.array(self.arm.limits or [(0.0, 2.0 * np.pi)] * len(self.arm.links))
        return limits[:, 0], limits[:, 1] - limits[:, 0]

    @property
    def steps(self) -> int:
        """Code steps in a joint's range: on a full circle the step after the last leads back to the first."""
        return (1 << self.bits) - (0 if self.arm.limits is None else 1)


class ArmIk(ArmProblem):
    """Minimise f(θ) = ‖d(θ) − X‖, +∞ in collision (Ahuactzin et al. 1992, §3.1).

    Each joint angle is one integer of ``bits`` bits; a genome is their concatenation.
    """

    about: ClassVar[str] = "inverse kinematics of a planar arm among obstacles"
    template: ClassVar[str] = """\
kind = "arm-ik"
target = [1.2, 0.9]             # m, where the tip shall be
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
    batches_alike: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    target: Place = quantity("m", "where the tip shall be, [x, y]")

    @cached_property
    def coding(self) -> BitString:
        """One integer a joint (§3.1 step 1)."""
        from genetics.bit_string import BitString

        return BitString(len(self.arm.links), self.bits, gray=self.code != "binary")

    @property
    def code_step(self) -> float:
        """The tip's displacement if each joint of the arm at full stretch is off by half a code step, m.

        Some coded configuration is that near to any other in every joint, so that near to any reachable target.
        """
        return self._sweep / self.steps / 2

    @cached_property
    def _sweep(self) -> float:
        """How far the tip of the arm at full stretch goes if each joint turns by all of its range, m."""
        stretch_beyond = np.cumsum(self.arm.links[::-1])[::-1]
        return float(np.sum(stretch_beyond * self.joint_ranges[1]))

    @property
    def solved_at(self) -> float | None:
        """1 mm, or the code's step if that is more, m; None if that is half of the arm's reach or more.

        With such a code nearly any configuration would be near enough: that would be no target.
        """
        step = self.code_step
        return None if 2.0 * step >= sum(self.arm.links) else max(MILLIMETRE, step)

    @property
    def solved_when(self) -> str:
        """Which of the two it is, and why."""
        step, share = self.code_step, self.code_step / sum(self.arm.links)
        coded = f"half a step of {self.bits} bits in each joint moves the stretched arm's tip by {step:.3g} m"
        if self.solved_at is None:
            return f"the code's step is too coarse for one: {coded}, {share:.0%} of its reach"
        if step < MILLIMETRE:
            return f"1 mm from the target, since the code's step is less: {coded}"
        bits = int(np.ceil(np.log2(self._sweep / (2 * MILLIMETRE) + 1)))
        return f"m from the target, the code's step: {coded}, {share:.1%} of its reach; {bits} bits allow 1 mm"

    @property
    def unreachable(self) -> str | None:
        """A target farther from the base than the arm reaches, or nearer; see `problems.arm_ik.reach`."""
        return reach.complaint(self)

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """The paper's: §3.1 and §6 to the letter. Tuned: elitist, uniform crossover and more mutation.

        Two links of 8 bits on an 8 × 8 torus find the discretised optimum of 91 % of random worlds with a mutation of
        0.05 and one-point crossover, of 98.9 % with 0.1, and of 99.8 % with 0.15 and uniform crossover.
        """
        if name == "paper":
            return Recipe("one-point", ONE_BIT if deme > 1 else 1.0 / self.coding.length, "offspring")
        flips = _FLIPS if deme == 1 else _FLIPS_ON_ISLANDS
        return Recipe("uniform", min(0.5, flips / self.coding.length), "elitist")

    def configurations(self, integers: NDArray[np.int64]) -> Configurations:
        """The joint angles that coded integers stand for, rad: (n, links) to (n, links)."""
        from problems.arm_ik import kernels

        return kernels.configurations(np.require(integers, np.int64, ["C", "W"]), self._compiled.table)

    def angles(self, genomes: Genomes) -> Configurations:
        """The joint angles that genomes code, rad: (n, genome_bytes) to (n, links)."""
        return self.configurations(self.coding.integers(genomes))

    def distances(self, configurations: Configurations) -> Fitness:
        """The tip's distance to the target, m, +inf in collision: (n, links) to (n,)."""
        from problems.arm_ik import kernels

        return kernels.distances(np.require(configurations, np.float64, ["C", "W"]), self._compiled.table)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """See `distances`: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code, whatever the fields: nothing of it is left to Python."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """``{"configuration": [..], "tip": [x, y], "distance": d}``."""
        angles = self.angles(genome[None])[0]
        headings = np.cumsum(angles)
        tip = self.arm.base + np.array(self.arm.links) @ np.column_stack([np.cos(headings), np.sin(headings)])
        return {
            "configuration": angles.tolist(),
            "tip": tip.tolist(),
            "distance": float(np.hypot(*(tip - self.target))),
        }

    def describe(self, solution: Solution) -> str:
        """Where the tip is, and the joint angles."""
        x, y = solution["tip"]
        angles = ", ".join(f"{angle:.4f}" for angle in solution["configuration"])
        return f"tip at ({x:.4f}, {y:.4f}) m, {solution['distance']:.4g} m from the target\njoints at {angles} rad"

    def check(self, solution: Solution) -> Verdict:
        """See `problems.arm_ik.checker`, which shares no code with `evaluate`."""
        return checker.verify(self, solution)

    def oracle(self) -> Answer:
        """See `problems.arm_ik.oracle`: enumeration of few codes, else the arm's reach and a local solver."""
        from problems.arm_ik import oracle

        return oracle.solve_exactly(self)

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """The arm in its world; for two links beside it the configuration space (figures 1 to 3 of the paper)."""
        from problems.arm_ik import drawing

        drawing.draw(self, figure, solution, populations)

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, and the table of all kernels."""
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
    """The left, lower, right and upper bound of each shape, shape (shapes, 4)."""
    boxes = np.empty((len(shapes.thickness), 4))
    for number, thickness in enumerate(shapes.thickness):
        corners = shapes.corners[shapes.starts[number] : shapes.starts[number + 1]]
        boxes[number] = [*(corners.min(axis=0) - thickness), *(corners.max(axis=0) + thickness)]
    return boxes
