"""The model of terrain (Fries): the easiest path over a grid of fuzzy difficulty."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, field_validator, model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from problems.errors import BadInput, shorten
from problems.problem import Problem, Solution
from problems.tables import RecipeName, Table, quantity
from problems.terrain import movingai
from problems.terrain.arrays import world_arrays
from problems.terrain.obstacles import HAIR, distances_from, obstacles_of
from problems.terrain.solution import solution_of

if TYPE_CHECKING:
    from genetics.operators import Operator
    from problems.terrain.coding import Moves

MOST_SIDE = 1024
IMPASSABLE = "impassable"

Place = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]
_HEADINGS = ("E", "NE", "N", "NW", "W", "SW", "S", "SE")  # heading k is k·π/4, anticlockwise
Compass = Literal["E", "NE", "N", "NW", "W", "SW", "S", "SE"]


def _ordered(triangle: tuple[float, float, float]) -> tuple[float, float, float]:
    if not triangle[0] <= triangle[1] <= triangle[2]:
        raise ValueError(f"expected a triangle [a, b, c] with a <= b <= c, found {list(triangle)}")
    return triangle


Degree = Annotated[float, Field(ge=1e-3, le=1e6)]
Fuzzy = Annotated[tuple[Degree, Degree, Degree], AfterValidator(_ordered)]


class Slope(Table):
    """A difficulty that depends on the heading: within 45° of uphill, across, or within 45° of downhill (§3.4)."""

    uphill: Compass = quantity("", 'the direction in which it rises: "N" is towards row 0, "E" towards greater columns')
    up: Fuzzy = quantity("", "difficulty of a step up: a triangle [a, b, c]")
    across: Fuzzy = quantity("", "difficulty of a step across")
    down: Fuzzy = quantity("", "difficulty of a step down")


DIFFICULTIES: dict[str, Fuzzy | Slope] = {  # figure 5 has no numbers: these are stand-ins
    "clear": (1.0, 1.0, 1.0),
    "easy": (1.0, 1.25, 1.5),
    "moderate": (1.25, 1.5, 2.0),
    "difficult": (2.0, 3.0, 4.0),
}
TERRAIN = {".": "clear", "G": "clear", "S": "clear"}


class TerrainModel(Problem):
    """The fields, coding, recipe, fitness and decoding; `Terrain` adds what verifies and shows solutions."""

    about: ClassVar[str] = "a path over terrain of fuzzy difficulty, on a grid"
    template: ClassVar[str] = """\
kind = "terrain"
start = [13, 2]                 # row, column; row 0 is the first of the map
goal = [2, 12]
map = [                         # or: file = "x.map", a map of MovingAI, beside this file
    "................",
    "................",
    "......####......",
    ".........#......",
    ".........#..mmm.",
    "...dddd..#..mmm.",
    "...dddd..#..mmm.",
    "...dddd..#..mmm.",
    ".........####.##",
    "................",
    "####.####.......",
    "........#..eee..",
    "........#..eee..",
    "........#..eee..",
    "........#.......",
    "........#.......",
]
corner_cutting = true           # whether a diagonal step may pass the corner of an impassable cell
rank = "centroid"               # of fuzzy costs; or "pessimistic", "optimistic"
robot_radius = 0.0              # cells; impassable cells grow by it
# clearance = 0.2               # cells, beyond robot_radius, that all of the way keeps from impassable cells

[terrain]                       # what a character of the map is; ".", "G" and "S" are clear, all else is impassable
e = "easy"
m = "moderate"
d = "difficult"

[difficulty]                    # triangular fuzzy numbers, by which a step's length is multiplied
easy = [1.0, 1.25, 1.5]
moderate = [1.25, 1.5, 2.0]
difficult = [2.0, 3.0, 4.0]
# [difficulty.hill]             # by heading
# uphill = "N"
# up = [2.0, 3.0, 4.0]
# across = [1.25, 1.5, 2.0]
# down = [1.0, 1.0, 1.25]

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    start: Place = quantity("cell", "where the robot stands: [row, column]")
    goal: Place = quantity("cell", "where it is to go: [row, column]")
    file: str | None = quantity(
        "", "a MovingAI map beside the problem file, instead of 'map'; its rows replace it when read", default=None
    )
    map: Annotated[list[str], Field(min_length=1, max_length=MOST_SIDE)] = quantity(
        "", "the rows of the map, one character a cell, the first row at the top; or give 'file'"
    )
    terrain: dict[str, str] = quantity(
        "",
        "what a character of the map is: the name of a difficulty, or \"impassable\"; '.', 'G' and 'S' are clear "
        "unless stated otherwise, all others impassable",
        default_factory=dict,
    )
    difficulty: dict[str, Fuzzy | Slope] = quantity(
        "",
        "triangular fuzzy numbers [a, b, c] by which a step's length is multiplied, or a table of them by heading; "
        "in addition to clear, easy, moderate and difficult, or instead of them",
        default_factory=dict,
    )
    corner_cutting: bool = quantity(
        "", "whether a diagonal step may pass the corner of an impassable cell", default=True
    )
    rank: Literal["centroid", "pessimistic", "optimistic"] = quantity(
        "", "how fuzzy costs [a, b, c] are compared: by (a + b + c)/3, by c, or by a", default="centroid"
    )
    robot_radius: float = quantity(
        "cell", "a cell counts as impassable if its centre is nearer than this to one", default=0.0, ge=0.0, le=64.0
    )
    clearance: float = quantity(
        "cell",
        "how far the robot keeps from impassable cells all the way, also half-way between diagonal cells",
        default=0.0,
        ge=0.0,
        le=64.0,
    )
    blocks: int | None = quantity(
        "", "the most blocks of a genome; if not given, 4 to each cell of the longer side", default=None, ge=1, le=16384
    )
    founders: Literal["random", "lines"] | None = quantity(
        "",
        "how first paths are made: of random blocks, or of straight lines through random cells; if not given, the "
        'recipe\'s: tuned "lines", paper "random"',
        default=None,
    )

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Replace the name of a map's file with the map's rows, so that nodes and digests see the map itself."""
        if "file" not in fields:
            return fields
        name = fields["file"]
        if not isinstance(name, str):
            raise BadInput(f"file: expected the name of a map, found {shorten(name)}")
        if "map" in fields:
            raise BadInput("map: expected either map or file, found both")
        others = {field: value for field, value in fields.items() if field != "file"}
        return others | {"map": movingai.read(folder / name)}

    @field_validator("file")
    @classmethod
    def _was_read(cls, file: str | None) -> str | None:
        if file is not None:
            raise ValueError(f"expected map, the rows themselves, as `supernode.load` reads them, found {file!r}")
        return file

    @field_validator("map")
    @classmethod
    def _rectangular(cls, rows: list[str]) -> list[str]:
        for number, row in enumerate(rows):
            if len(row) != len(rows[0]) or not 1 <= len(row) <= MOST_SIDE:
                raise ValueError(
                    f"expected rows of the same length, 1 to {MOST_SIDE}, found {len(row)} characters in row {number}"
                    f" and {len(rows[0])} in row 0"
                )
        return rows

    @field_validator("terrain")
    @classmethod
    def _by_character(cls, terrain: dict[str, str]) -> dict[str, str]:
        for character in terrain:
            if len(character) != 1:
                raise ValueError(f"expected one character for each terrain, found {character!r}")
        return terrain

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        for character, name in self.terrain.items():
            if name != IMPASSABLE and name not in self.difficulties:
                expected = ", ".join([*self.difficulties, IMPASSABLE])
                raise ValueError(f"terrain.{character}: expected one of {expected}, found {shorten(name)}")
        return self

    @model_validator(mode="after")
    def _stands_free(self) -> Self:
        for name, (row, column) in (("start", self.start), ("goal", self.goal)):
            if not (row < len(self.map) and column < len(self.map[0])):
                raise ValueError(
                    f"{name}: expected a cell of the map, {len(self.map)} rows of {len(self.map[0])}, "
                    f"found [{row}, {column}]"
                )
            if self.impassable[row, column]:
                thick = self.robot_radius + self.clearance > 0.0
                raise ValueError(
                    f"{name}: expected a cell where the robot stands free, found [{row}, {column}], which is "
                    f"{self.map[row][column]!r}" + (" or too near to an impassable one" if thick else "")
                )
        return self

    @cached_property
    def difficulties(self) -> dict[str, Fuzzy | Slope]:
        """All difficulties by name."""
        return DIFFICULTIES | self.difficulty

    @cached_property
    def legend(self) -> dict[str, str]:
        """The name of the difficulty of each character that is passable."""
        # The file's entries replace the defaults; a character without an entry is an obstacle.
        return {character: name for character, name in (TERRAIN | self.terrain).items() if name != IMPASSABLE}

    @cached_property
    def impassable(self) -> NDArray[np.bool_]:
        """The cells where the robot cannot stand, (rows, columns): obstacles, and cells too near to them.

        For validation, `check` and the oracle; the fitness has its own classes of cells.
        """
        if self.robot_radius + self.clearance > 0.0:
            near: NDArray[np.bool_] = self.distances[1::2, 1::2] < self.least_allowed
            return near
        return obstacles_of(self.map, self.legend)

    @cached_property
    def distances(self) -> NDArray[np.float64]:
        """Distances of cells' centres and corners from obstacles, see `problems.terrain.obstacles.distances_from`."""
        return distances_from(obstacles_of(self.map, self.legend))

    @property
    def least_allowed(self) -> float:
        """The least distance from an obstacle, in cells, at which the robot's axis may be."""
        return (self.robot_radius + self.clearance) * (1.0 - HAIR)

    def _ranked(self, name: str, heading: int) -> float:
        """Return a difficulty for a heading, in eighths of a turn anticlockwise, as one number, by `rank`."""
        difficulty = self.difficulties[name]
        if not isinstance(difficulty, tuple):
            off = abs((heading - _HEADINGS.index(difficulty.uphill) + 4) % 8 - 4)  # eighths of a turn from uphill
            difficulty = difficulty.up if off < 2 else difficulty.across if off == 2 else difficulty.down
        a, b, c = difficulty
        match self.rank:
            case "pessimistic":
                return c
            case "optimistic":
                return a
            case _:
                return (a + b + c) / 3.0

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return the problem with the recipe's way of making first paths, unless the file states one."""
        if self.founders is not None:
            return self
        founders = "lines" if name == "tuned" else "random"
        return self.model_validate(self.model_dump(exclude_unset=True) | {"founders": founders})

    @cached_property
    def coding(self) -> Moves:
        """The coding: blocks of a direction and a length (§3.1)."""
        from problems.terrain.coding import Moves

        side = max(len(self.map), len(self.map[0]))
        most = max(64, 4 * side) if self.blocks is None else self.blocks
        settings = [*self.start, *self.goal, self.corner_cutting]
        world = world_arrays(self.map, self.legend, self._ranked, settings, self.robot_radius, self.clearance)
        return Moves(world, side, most, self.founders or "lines")

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the recipe of §3.3 as far as it is stated (paper), or best paths over both parents' cells (tuned)."""
        if name == "tuned":
            return Recipe("merge", 0.5, "elitist")
        if deme == 1:
            return Recipe("one-point", 0.02, "offspring")
        return Recipe("one-point", 0.02, "elitist", renewal=0.5)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the costs of clear paths to the goal, and greater penalties of others: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code. All variants of the problem are compiled; none needs Python."""
        return self._compiled

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"path": [[row, column], ..], "cost": c, "moves": [[heading, cells], ..]}``.

        Headings are in rad, 0 towards greater columns, π/2 towards row 0. The cost is that of all clear steps; it is
        the fitness of a path that is clear and leads to the goal.
        """
        from problems.terrain import kernels

        moves, cost = kernels.follow(writable(genome), self._compiled.table)
        return solution_of(self.start, np.repeat(moves[:, 0], moves[:, 1]), cost)

    def describe(self, solution: Solution) -> str:
        """Return the cost and the moves as text, one move a line."""
        moves = solution["moves"]
        calls = [f"heading {np.degrees(heading):4.0f}°, {cells} cells" for heading, cells in moves]
        return "\n".join([f"cost {solution['cost']:.6g}, {len(moves)} moves, {len(solution['path'])} cells:", *calls])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, with the table that all kernels read; `problems.terrain.walking.World` names its parts."""
        from genetics.operators import Operator
        from problems.terrain import kernels

        return Operator.of(kernels.evaluate, *self.coding.world)
