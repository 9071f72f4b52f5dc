"""The model of coordination: where two manipulators on given paths wait for each other to arrive soon, not collide."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ConfigDict, ValidationError, model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from problems.angles import WithAngles
from problems.coordination import arms
from problems.coordination.arms import Robot
from problems.coordination.diagram import Arrays, Diagram, Mask, RandomDiagram, move_times
from problems.digests import digest
from problems.errors import BadInput
from problems.problem import Solution
from problems.tables import RecipeName, derived, quantity

if TYPE_CHECKING:
    from genetics.bit_string import BitString
    from genetics.operators import Operator
    from problems.coordination.coding import SynchronisationPoints


class CoordinationModel(WithAngles):
    """The fields, coding, recipe, fitness and decoding; `Coordination` adds what verifies and shows solutions."""

    model_config = ConfigDict(serialize_by_alias=True)

    about: ClassVar[str] = "where two manipulators on given paths wait for each other"
    template: ClassVar[str] = """\
kind = "coordination"
coding = "variable"             # of the synchronisation points; or "fixed", "binary"
points = 20                     # how many of them; for "variable" the most at first

[diagram]                       # cell (i, j): robot 1 is in stretch i of its path, robot 2 in stretch j
cells = [60, 40]                # stretches of the paths
times = [[0.1, 0.2], [0.15, 0.2]]   # s, of each robot: for a cell at its speed, to reach that speed
obstacles = [                   # where the robots would collide: [i0, j0, i1, j1], both ends included
    [10, 5, 22, 12],
    [30, 10, 38, 26],
    [45, 30, 50, 36],
]

# [random]                      # instead of [diagram]: sixteen regions on 180 x 180 cells
# seed = 1
# layout = "mirrored"           # or "scattered"

# clearance = 0.02              # m, between two arms; above the tables
# [[robots]]                    # twice, instead of [diagram]: arms, by default SCORBOT-like
# path = [[0.0, 0.5, -0.9, 0.4, 0.0], [1.4, 0.5, -0.9, 0.4, 0.0]]   # rad
# base = [0.0, 0.0, 0.0, 0.0]   # m, m, m, rad; with unit = "deg" above, all angles are in degrees

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    individuals: Literal["variable", "fixed", "binary"] = quantity(
        "",
        "how individuals are coded: a variable or a fixed number of synchronisation points, or bits",
        default="variable",
        alias="coding",
    )
    points: int = quantity(
        "", "synchronisation points of an individual; if variable, the most at first", default=20, ge=1, le=1000
    )
    bits: int = quantity("bit", "bits of each coordinate, if the coding is binary", default=8, ge=1, le=16)
    diagram: Diagram | None = quantity("", "which cells collide, and how long moves take", default=None)
    random: RandomDiagram | None = quantity("", "instead of diagram, a random one", default=None)
    robots: list[Robot] | None = quantity("", "instead of diagram, two arms", default=None, min_length=2, max_length=2)
    clearance: float = quantity("m", "least distance between the links of two arms", default=0.0, ge=0, le=1e3)
    # The next two are computed once, by `derive_fields`, and sent to the nodes with the other fields.
    collisions: Diagram | None = derived("the diagram of the robots", default=None)
    collisions_of: str | None = derived("digest of what collisions was made of", default=None)

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        """Refuse more or fewer than one source of the diagram, and a clearance without arms to keep it."""
        given = [name for name in ("diagram", "random", "robots") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of diagram, random, robots, found {' and '.join(given) or 'none'}")
        if self.clearance and self.robots is None:
            raise ValueError(f"clearance: expected robots that keep it: cells of a diagram have none, found {given[0]}")
        return self

    @model_validator(mode="after")
    def _free_at_both_ends(self) -> Self:
        for name, cell in (("start", (0, 0)), ("end", self.last)):
            if self.blocked[cell]:
                raise ValueError(
                    f"expected the robots not to collide at the {name}, found cell {list(cell)} in collision"
                )
        return self

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Return the fields with each robot's ``result`` replaced by the path in that file."""
        robots = fields.get("robots")
        if not isinstance(robots, list):
            return fields
        return fields | {"robots": [_with_path(robot, folder, number) for number, robot in enumerate(robots)]}

    @classmethod
    def derive_fields(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """Return the fields with the diagram of the robots, computed again if the robots or the clearance changed."""
        if fields.get("robots") is None:  # drop the diagram of robots that an update has removed
            return {name: value for name, value in fields.items() if name not in ("collisions", "collisions_of")}
        made_of = digest([fields["robots"], fields.get("clearance", 0.0)])
        if fields.get("collisions_of") == made_of:
            return fields
        fields = {name: value for name, value in fields.items() if name != "collisions"}
        try:
            problem = cls.model_validate_json(json.dumps(fields), strict=True)
        except ValidationError:
            return fields  # the validation that follows reports the error
        return fields | {"collisions": problem.world.model_dump(mode="json"), "collisions_of": made_of}

    @cached_property
    def world(self) -> Diagram:
        """The diagram: given in the file, computed from the robots, or random."""
        if (known := self.diagram or self.collisions) is not None:
            return known
        if self.random is not None:
            return Diagram.of(self.random.mask(), self.random.times)
        assert self.robots is not None, "a diagram comes from somewhere"
        first, second = self.robots
        return arms.diagram(first, second, self.clearance)

    @cached_property
    def blocked(self) -> Mask:
        """The obstacle cells, shape (N1, N2)."""
        return self.world.mask()

    @property
    def last(self) -> tuple[int, int]:
        """The cell where both robots have arrived."""
        first, second = self.world.cells
        return first - 1, second - 1

    @cached_property
    def move_times(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """For each robot the time that it takes for 0, 1, .. cells from rest to rest, s."""
        (first, second), (times_1, times_2) = self.world.cells, self.world.times
        return move_times(first, times_1), move_times(second, times_2)

    @cached_property
    def offset(self) -> float:
        """K, s: more than the time of any valid individual, which has fewer than N1 + N2 rectangles.

        So every valid individual is better than every invalid one.
        """
        times_1, times_2 = self.move_times
        return sum(self.world.cells) * float(max(times_1[-1], times_2[-1]))

    @cached_property
    def arrays(self) -> Arrays:
        """The diagram for the kernels: the move times of both robots, and the summed-area table of the obstacles."""
        sums = np.zeros((self.world.cells[0] + 1, self.world.cells[1] + 1), np.int64)
        sums[1:, 1:] = self.blocked.cumsum(axis=0).cumsum(axis=1)
        return (*self.move_times, sums)

    @cached_property
    def coding(self) -> SynchronisationPoints | BitString:
        """SPs as integers (§3.1, §3.2), or as bits: two coordinates for each SP."""
        if self.individuals == "binary":
            from genetics.bit_string import BitString

            return BitString(2 * self.points, self.bits)
        from problems.coordination.coding import SynchronisationPoints

        return SynchronisationPoints(self.arrays, self.points, self.individuals == "variable")

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the paper's operators (§3.2, evolutionary algorithm characteristics), or the tuned ones.

        Binary individuals have the same operators in both recipes.
        """
        if self.individuals == "binary":
            return Recipe("one-point", 1.0 / (2 * self.points * self.bits), "elitist", renewal=1.0)
        if name == "paper":
            return Recipe("sp", 0.5, "elitist", renewal=1.0)
        return Recipe("sp-tuned", 1.0, "elitist")

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the time of valid individuals, s, and K + obstacle cells of others: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code, for every combination of fields."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"time": s, "points": [[i, j], ..]}``, without start, end and repeated SPs."""
        from problems.coordination import kernels

        points, time = kernels.follow(writable(genome), self._compiled.table)
        return {"time": float(time), "points": _distinct(points.tolist(), self.last)}

    def describe(self, solution: Solution) -> str:
        """Return the time and the SPs in words, one a line."""
        count = len(solution["points"])
        stops = [f"robot 1 at cell {i:4d}, robot 2 at cell {j:4d}" for i, j in solution["points"]]
        return "\n".join([f"{solution['time']:.3f} s with {count} synchronisation points:", *stops])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness as an operator; `problems.coordination.kernels` describes its table."""
        from genetics.operators import Operator
        from problems.coordination import kernels
        from problems.coordination.coding import ROOM

        room = self.points if self.individuals != "variable" else ROOM * self.points
        binary = self.individuals == "binary"
        return Operator.of(kernels.evaluate, [binary, self.bits, room], *self.arrays, self.offset)


def _distinct(points: list[list[int]], last: tuple[int, int]) -> list[list[int]]:
    """Return the SPs without those that repeat the one before, the start or the end: nobody moves on the way there."""
    kept: list[list[int]] = []
    for point in points:
        if point not in ([0, 0], list(last), *kept[-1:]):
            kept.append(point)
    return kept


def _with_path(robot: Any, folder: Path, number: int) -> Any:
    """Return a robot's fields with ``result``, the name of a file, replaced by the path in that file."""
    if not (isinstance(robot, dict) and isinstance(robot.get("result"), str)):
        return robot
    if "path" in robot:
        raise BadInput(f"robots[{number}]: expected either path or result, found both")
    try:
        path = arms.path_of_result(robot["result"], folder)
    except BadInput as error:
        raise BadInput(f"robots[{number}].result: {error}") from None
    return {name: value for name, value in robot.items() if name != "result"} | {"path": path}
