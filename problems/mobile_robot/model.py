"""The model of mobile-robot (§5): a robot among obstacles, driven by rotate and move commands."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from problems.angles import Angle, WithAngles
from problems.mobile_robot.arrays import floor_arrays, robot_arrays
from problems.mobile_robot.body import Body, Metres
from problems.mobile_robot.guide import Guide, guide_of
from problems.plane import Obstacle
from problems.problem import CodedProblem, Solution
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.bit_string import BitString
    from genetics.operators import Operator

Pose = tuple[Metres, Metres, Angle]

_FLIPS = 12.0  # bits that the tuned recipe changes in an offspring, on average
_FLIPS_ON_ISLANDS = 16.0

_FEWEST_COMMANDS = 8  # if the number follows from the floor
_MOST_COMMANDS = 24
_MOST_AT_LAST = 64  # in later attempts


class MobileRobotModel(CodedProblem, WithAngles):
    """The fields, coding, recipe, fitness and decoding; `MobileRobot` adds what verifies and shows solutions."""

    about: ClassVar[str] = "a path of rotate and move commands for a mobile robot among obstacles"
    template: ClassVar[str] = """\
kind = "mobile-robot"
# unit = "deg"                  # of all angles in this file; "rad" if not given
start = [1.0, 1.0, 0.0]         # m, m, rad: x, y, heading (anticlockwise from +x)
goal = [6.8, 1.2, 1.57]         # m, m, rad
# commands = 10                 # pairs of a rotate and a move command; if not given, by the number of obstacles
bits = 8                        # of each command
# code = "gray"                 # or "binary"; if not given, the recipe's
# guide = "around"              # or "straight": how the way to the goal is measured; if not given, the recipe's
# shorten = true                # whether ways that have been found are shortened; if not given, the recipe's
# clearance = 0.05              # m, that the robot keeps from obstacles and walls
bounds = [0.0, 0.0, 8.0, 6.0]   # m, the walls around the floor: x0, y0, x1, y1

[robot]                         # in its own frame: it turns about the origin, ahead is +x
vertices = [[-0.35, -0.25], [0.25, -0.25], [0.4, 0.0], [0.25, 0.25], [-0.35, 0.25]]   # m
# radius = 0.3                  # m, of a disc, instead of vertices

[[obstacles]]                   # a wall with a gap above it
shape = "box"
center = [3.0, 2.0]             # m
size = [0.2, 4.0]               # m

[[obstacles]]                   # a wall with a gap below it
shape = "box"
center = [5.2, 3.8]             # m
size = [0.2, 4.4]               # m
angle = 0.0                     # rad

[[obstacles]]
shape = "circle"
center = [4.1, 2.6]             # m
radius = 0.3                    # m

[[obstacles]]
shape = "polygon"
vertices = [[6.4, 3.2], [7.4, 3.0], [7.0, 3.9]]   # m

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    start: Pose = quantity("m, m, rad", "where the robot stands: [x, y, heading]")
    goal: Pose = quantity("m, m, rad", "where it is to go: [x, y, heading]")
    commands: int | None = quantity(
        "",
        "pairs of a rotate and a move command; if not given, 8 and one for each two obstacles, but at most 24",
        default=None,
        ge=1,
        le=1000,
    )
    bits: int = quantity("bit", "bits of each command", default=8, ge=1, le=62)
    guide: Literal["straight", "around"] | None = quantity(
        "",
        "fitness of a scan that does not see the goal: the straight distance from where it ends, or the way around the"
        ' obstacles from where that is least; if not given, the recipe\'s: tuned "around", paper "straight"',
        default=None,
    )
    shorten: bool | None = quantity(
        "",
        "whether a way that has been found is shortened; if not given, the recipe's: tuned true, paper false",
        default=None,
    )
    bounds: tuple[Metres, Metres, Metres, Metres] = quantity("m", "the walls around the floor: [x0, y0, x1, y1]")
    clearance: float = quantity("m", "how far the robot keeps from obstacles and walls", default=0.0, ge=0, le=1e4)
    robot: Body = quantity("", "the robot")
    obstacles: list[Obstacle] = quantity(
        "", "solid shapes that the robot may touch, but not enter", default_factory=list
    )

    @classmethod
    def derive_fields(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """Fill in the number of commands, which follows from the number of obstacles.

        It is chosen once, when the file is read. Later updates of the obstacles must keep it, since the individuals of
        a running job have genomes of that length.
        """
        obstacles = fields.get("obstacles", [])
        # A field of a wrong type is left as it is; validation names it.
        if fields.get("commands") is not None or not isinstance(obstacles, list):
            return fields
        return fields | {"commands": _commands_for(len(obstacles))}

    @field_validator("bounds")
    @classmethod
    def _in_order(cls, bounds: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        x0, y0, x1, y1 = bounds
        if not (x0 < x1 and y0 < y1):
            raise ValueError(f"expected x0 < x1 and y0 < y1, found {list(bounds)}")
        return bounds

    @property
    def solved_at(self) -> float:
        """The fitness of a path that reaches the goal."""
        return 0.0

    @cached_property
    def coding(self) -> BitString:
        """The coding: one integer for each command, rotate, move, rotate, .. (§5)."""
        from genetics.bit_string import BitString

        return BitString(2 * self.pairs, self.bits, gray=self.code != "binary")

    @property
    def pairs(self) -> int:
        """The number of pairs of commands, given in the file or by the number of obstacles."""
        return _commands_for(len(self.obstacles)) if self.commands is None else self.commands

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return the problem with what the file leaves to the recipe: as in §5 (paper), or what works best (tuned)."""
        coded = super().for_recipe(name, deme)
        return coded.filled_in(guide="around" if name == "tuned" else "straight", shorten=name == "tuned")

    def next_attempt(self, attempt: int) -> dict[str, Any] | None:
        """Return half as many commands again; None for the paper's guide, since the paper has no further attempts."""
        if self.guide == "straight":
            return None
        # Never fewer than before, even if the file asks for more than the bound.
        return {"commands": max(self.pairs, min(_MOST_AT_LAST, self.pairs * 3 // 2))}

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the recipe of §6 as far as it is stated (paper), or elitist replacement with more mutation (tuned)."""
        if name == "paper":
            return Recipe("one-point", 1.0 / self.coding.length, "offspring")
        if deme == 1:
            return Recipe("one-point", min(0.5, _FLIPS / self.coding.length), "elitist")
        return Recipe("uniform", min(0.5, _FLIPS_ON_ISLANDS / self.coding.length), "elitist")

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return 0 if the goal is visible, else how far the scan stays from it, m: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code. All variants of the problem are compiled; none needs Python."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"commands": [["rotate", rad], ["move", m], ..], "path": [[x, y, heading], ..], "length": m}``.

        The number of a rotate command is the turn to make, anticlockwise if positive, so it also states which sense is
        free. Headings are in the path, which has one pose more than there are commands. If the goal is visible, both
        end there, and with `shorten` the commands may differ from those of the genome.
        """
        from problems.mobile_robot import kernels

        path, scanned = kernels.follow(writable(genome), self._compiled.table, self.shorten is not False)
        # Two turns may follow each other where the scan ended after a turn, so the names begin with "rotate" again.
        names = [["rotate", "move"][number % 2] for count in (scanned, len(path)) for number in range(count)]
        steps = np.diff(path, axis=0)
        lengths = np.hypot(steps[:, 0], steps[:, 1])
        commands = [
            [name, float(turn if name == "rotate" else length)]
            for name, turn, length in zip(names, steps[:, 2], lengths, strict=False)
        ]
        return {"commands": commands, "path": path.tolist(), "length": float(lengths.sum())}

    def describe(self, solution: Solution) -> str:
        """Return the length and the commands as text, one command a line."""
        calls = [_called_out(name, value) for name, value in solution["commands"]]
        return "\n".join([f"a way of {solution['length']:.2f} m by {len(calls)} commands:", *calls])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, with the table that all kernels read; `problems.mobile_robot.kernels` names its parts."""
        from genetics.operators import Operator
        from problems.mobile_robot import guide_kernels, kernels

        (outline, thickness), floor = self._arrays
        goes_around = self.guide != "straight"
        return Operator.of(
            kernels.evaluate,
            [self.bits, self.coding.gray, self.coding.parameters, goes_around],
            np.array([self.start, self.goal]),
            [self.robot.circumscribed_radius, thickness],
            outline,
            *floor,
            self.grid[:3],
            # The paper's guide reads no distances: a grid of one node stands in for them.
            guide_kernels.distances(self.grid, self.sources, floor) if goes_around else np.zeros((1, 1)),
            self.approaches,
        )

    @cached_property
    def _arrays(self) -> tuple[tuple[NDArray[np.float64], float], tuple[NDArray[Any], ...]]:
        """The robot and the floor as the arrays of the compiled code."""
        robot = robot_arrays(self.robot.vertices, self.robot.radius, self.clearance)
        return robot, floor_arrays(self.bounds, self.obstacles)

    @cached_property
    def approaches(self) -> NDArray[np.float64]:
        """Approaches to a goal that is too tight to turn in, (n, 7); see `problems.mobile_robot.approach_kernels`."""
        from problems.mobile_robot import approach_kernels

        if self.guide == "straight":
            return np.empty((0, 7))
        robot, floor = self._arrays
        return approach_kernels.approaches_to(np.array(self.goal), *robot, *floor)

    @property
    def sources(self) -> NDArray[np.float64]:
        """Where the way around the obstacles ends: x, y and the length left from there to the goal, m, (n, 3)."""
        approaches = self.approaches[self.approaches[:, 6] > 0.0]
        return np.ascontiguousarray(approaches[:, [0, 1, 5]]) if len(approaches) else np.array([[*self.goal[:2], 0.0]])

    @cached_property
    def grid(self) -> Guide:
        """The grid over which the way around the obstacles is measured."""
        return guide_of(self.bounds, self.robot, self.clearance)


def _commands_for(obstacles: int) -> int:
    """Return the number of pairs of commands for a floor with so many obstacles."""
    return min(_MOST_COMMANDS, _FEWEST_COMMANDS + obstacles // 2)


def _called_out(name: str, value: float) -> str:
    if name == "move":
        return f"move {value:7.3f} m"
    return f"turn {abs(np.degrees(value)):7.2f}° {'left' if value >= 0.0 else 'right'}"
