"""What a planner is: a coding, an evaluation, a decoder, a checker and a drawing, described by a typed schema.

A problem is a pydantic model whose fields are those of the problem file, so the schema, its validation and the planner
that uses it are one thing.
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from genetics.arrays import Fitness, Genomes
from genetics.recipe import Recipe
from problems.errors import BadInput
from problems.plain_genomes import from_plain, to_plain

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from genetics.coding import Coding
    from genetics.operators import Operator
    from problems.motion import Motion, Pace
    from problems.run import Run

RecipeName = Literal["tuned", "paper"]
Solution = dict[str, Any]  # plain JSON values
Populations = Mapping[int, Genomes]  # generation to genomes, shape (n, genome_bytes)

CHECKED = {"checked": True}
"""The context of a validation that may leave out what costs time, since another process has done it."""

MOST_REPORT_BYTES = 1 << 12  # a thousand cells report at once


@dataclass(frozen=True)
class Clearance:
    """How close a solution comes to an obstacle, or to whatever else it must not touch.

    Attributes:
        least: the least distance, in the unit of the planner's space (m where there is one); negative where bodies
            overlap, if the planner measures by how much; +inf if there is nothing to come close to.
        where: what is that close, and at which point of the solution, as plain JSON values such as
            ``{"configuration": [0.1, 0.2], "link": 2, "obstacle": 0}``.
        unit: of the distance; empty if the planner's space has none.
    """

    least: float
    where: dict[str, Any] = field(default_factory=dict)
    unit: str = "m"


@dataclass(frozen=True)
class Verdict:
    """What a check found.

    Attributes:
        fitness: the fitness of the solution, computed without the code that found it.
        objections: why the solution is not acceptable, in words; none if it is feasible.
        clearance: of the solution, as the check measured it; None if this kind of problem has none.
    """

    fitness: float
    objections: tuple[str, ...] = ()
    clearance: Clearance | None = None

    @property
    def feasible(self) -> bool:
        """Whether the solution is acceptable."""
        return not self.objections


@dataclass(frozen=True)
class Answer:
    """What an oracle knows of a problem.

    Attributes:
        meaning: what the figure is: the ``"optimum"`` among all coded solutions or all solutions at all, as the
            ``method`` says; or a ``"lower bound"`` or ``"upper bound"`` of it.
        fitness: the figure; +inf if there is surely no feasible solution.
        method: how it was got, in words.
        solution: one that has that fitness, as `Problem.decode` would say it, if the method finds any.
        figures: whatever else it tells, such as the fewest moves of any path.
    """

    meaning: Literal["optimum", "lower bound", "upper bound"]
    fitness: float
    method: str
    solution: Solution | None = None
    figures: Mapping[str, float | int | bool] = field(default_factory=dict)


class Table(BaseModel):  # noqa: PLW1641 - pydantic hashes what is frozen, by its fields
    """A table of a problem file: unknown fields, wrong types and numbers that are not finite are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __eq__(self, other: object) -> bool:
        """By the fields alone: what was worked out of them and kept may be arrays, which do not compare as a whole."""
        if type(other) is not type(self):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in type(self).model_fields)


def quantity(unit: str, description: str, **options: Any) -> Any:
    """A field with a unit, as `supernode problems` shows it."""
    return Field(description=description, json_schema_extra={"unit": unit}, **options)


class Problem(Table):
    """What to optimise. Lower fitness is better; +inf is infeasible.

    A subclass declares the fields of its problem file and implements `coding`, `evaluate` and, to say more than the
    coded numbers, `decode` and `check` (both or neither)::

        class Knapsack(supernode.Problem):
            weights: list[float]
            capacity: float

            @property
            def coding(self):
                return supernode.BitString(parameters=len(self.weights), bits=1)

            def evaluate(self, genomes):
                load = (self.coding.integers(genomes) * self.weights).sum(axis=1)
                return np.where(load <= self.capacity, self.capacity - load, np.inf)
    """

    about: ClassVar[str] = ""
    """One line for `supernode problems`."""
    template: ClassVar[str] = ""
    """A commented problem file, for `supernode init`."""

    batches_alike: ClassVar[bool] = False
    """Whether `evaluate` gives the same bits however genomes are batched (matrix products do not)."""

    any_thread: ClassVar[bool] = False
    """Whether `evaluate` may be called on any thread (one at a time): small generations cost less then."""

    oracle_decides: ClassVar[bool] = True
    """Whether bounds that `oracle` tells hold for the fitness of every solution, however a further attempt codes it.

    A run ends when such a bound says that there is no way, and one that has come to it ends as optimal. False where the
    oracle is a yardstick: a figure of the literature, or of a narrower set of solutions.
    """

    kind: str = Field(description="the kind of problem")

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """A compiled fitness is not inherited by who evaluates, or codes, in a way of their own."""
        own = vars(cls)
        if "fitness_kernel" not in own and ("evaluate" in own or "coding" in own):
            cls.fitness_kernel = Problem.fitness_kernel  # type: ignore[method-assign]

    @classmethod
    def read_angles(cls, fields: dict[str, Any], world: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """The fields of a problem file with angles in radians, whatever the unit that the file says.

        Called where a file is read, before `gather`, for built-in kinds.

        Args:
            fields: plain values as they were written, not yet checked.
            world: of the file of an update, the fields of the problem that it changes.

        Raises:
            BadInput: names an angle that is none.
        """
        return fields

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """The fields of a problem file with what other files hold in the place of their names (maps, meshes, paths).

        Called once, where a problem file is read, for built-in kinds: what nodes get, and what a problem's digest is
        made of, then names no file. ``fields`` are as they were written, not yet checked.

        Args:
            fields: plain values.
            folder: of the problem file; names of others are relative to it.

        Raises:
            BadInput: names the field, and the file that cannot be read.
        """
        return fields

    @classmethod
    def work_out(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """With what takes long to be worked out of them, so that nodes need not do it again; no file is read.

        Called where a problem file is read, after `gather`, and where its world has moved. Fields that are wrong are
        left to whoever makes the problem of them.
        """
        return fields

    @property
    @abstractmethod
    def coding(self) -> Coding:
        """How individuals are coded; cheap to ask for (use a cached property)."""

    @abstractmethod
    def evaluate(self, genomes: Genomes) -> Fitness:
        """The fitness of each genome: (n, genome_bytes) to (n,), never NaN; the same for the same genome."""

    @property
    def fitness_kernel(self) -> Operator | None:
        """`evaluate` as compiled code, of signature `genetics.operators.FITNESS`, if there is such; both must agree."""
        return None

    @property
    def solved_at(self) -> float | None:
        """A champion of this fitness or less solves the problem; None if there is no such figure."""
        return None

    @property
    def solved_when(self) -> str | None:
        """What solves the problem, in words that follow the figure of `solved_at`; or why there is no such figure."""
        return None

    @property
    def unreachable(self) -> str | None:
        """Why no solution can be as fit as `solved_at` asks, as a complaint about a field; None if that is not known.

        For built-in kinds. A file is refused for it before anything is run, unless the run has a target of its own; so
        it must be surely true, and cheap: a closed form, not a search.
        """
        return None

    def next_attempt(self, attempt: int) -> dict[str, Any] | None:
        """The fields to change for another attempt at this problem; ``{}``: none; None: it is not tried again.

        Asked of the problem of the attempt before, which may stall without reaching its target. The next attempt begins
        with new individuals, and with another seed. What is changed may alter how solutions are coded, not what they
        are: the fitness stays comparable, and `check` of the problem without these changes accepts what is found with
        them. Every process asks, some more than once: this is to be cheap, and the same each time.

        Args:
            attempt: its number; 1 is the first restart.
        """
        return None

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """This problem with whatever the recipe leaves open filled in (such as the code of its bits)."""
        return self

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """The operators of a recipe for demes of that size."""
        from genetics.bit_string import BitString
        from genetics.permutation import Permutation

        if isinstance(self.coding, BitString):
            return Recipe("one-point", 1.0 / self.coding.length, "offspring" if name == "paper" else "elitist")
        if isinstance(self.coding, Permutation):
            return Recipe("order", 0.5, "elitist")
        return Recipe("blend", 0.1, "elitist")

    def decode(self, genome: Genomes) -> Solution:
        """The solution that a genome, shape (genome_bytes,), stands for, as plain JSON values."""
        return to_plain(self.coding, genome)

    def for_cell(self) -> Self:
        """This problem with a state of its own, if evaluating leaves a state: each cell then has one.

        A state is for what is worth keeping from one evaluation to the next; it must not show in any fitness.
        """
        return self

    def report(self) -> bytes:
        """What a cell has to say of its state when it stops, at most `MOST_REPORT_BYTES`."""
        return b""

    def merge(self, solution: Solution, reports: Mapping[int, bytes], finder: int) -> Solution:
        """The solution with whatever the cells' reports add to it.

        Args:
            solution: as `decode` made it.
            reports: of the cells that had something to report, by their numbers.
            finder: the cell that found the solution.
        """
        return solution

    def describe(self, solution: Solution) -> str:
        """The solution in words, a line or a few."""
        return "\n".join(f"{name}: {json.dumps(value)}" for name, value in solution.items())

    def check(self, solution: Solution) -> Verdict:
        """Judge a solution, if possible without any code that `evaluate` uses.

        Raises:
            BadInput: if this is not a solution of such a problem at all.
        """
        try:
            genome = from_plain(self.coding, solution)
        except ValueError as error:
            raise BadInput(f"solution: {error}, for an individual of {self.kind}") from None
        fitness = float(self.evaluate(genome[None])[0])
        return Verdict(fitness, () if np.isfinite(fitness) else ("the individual is infeasible",))

    def oracle(self) -> Answer:
        """The optimum, or a bound, by an exact method that shares no code with `evaluate` and is no genetic algorithm.

        Raises:
            BadInput: if there is none for this problem.
        """
        raise BadInput(f"problems of kind {self.kind!r} have no oracle")

    def motion(self, solution: Solution, pace: Pace) -> Motion | None:
        """The solution as a motion over time, for `supernode export`; None if solutions of this kind are none.

        Args:
            solution: one that `check` accepts.
            pace: speed and acceleration along a path without times, and how densely the motion is told.

        Raises:
            BadInput: if ``pace`` does not suit the solution.
        """
        return None

    def advice(self, found: Solution | None, run: Run) -> list[str]:
        """What to turn when a run has stalled, a line each: a setting, a value to try, and the one that the run had.

        Args:
            found: the best that was found, as `decode` said it, feasible or not; None if there is nothing.
            run: the settings of the run.
        """
        from problems.advice import advice_on_length, advice_on_run

        length = advice_on_length(self)
        return [advice_on_run(run), *([] if length is None else [length])]

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the problem's world, and the solution in it if there is one, onto an empty figure.

        Args:
            figure: an empty figure; its size may be changed.
            solution: as `decode` made it.
            populations: all individuals of the torus at some generations, for a picture of how they converge.

        Raises:
            BadInput: if this kind of problem has no picture.
        """
        raise BadInput(f"problems of kind {self.kind!r} have no picture")


class CodedProblem(Problem):
    """A problem whose individuals are integers written in bits, by a code that the file or the recipe chooses."""

    code: Literal["binary", "gray"] | None = quantity(
        "", 'how an integer is written in bits; if not given, the recipe\'s: tuned "gray", paper "binary"', default=None
    )

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """The paper's binary code, or the tuned recipe's Gray code, unless the file chooses."""
        return self.filled_in(code="gray" if name == "tuned" else "binary")

    def filled_in(self, **choices: Any) -> Self:
        """This problem with these choices of the recipe, but for those that the file has made."""
        left_open = {name: choice for name, choice in choices.items() if getattr(self, name) is None}
        if not left_open:
            return self
        # Not validated anew: these fields decide nothing that a validation looks at, and a thousand nodes wait for it.
        chosen = self.model_copy(update=left_open)
        for cached in chosen.__dict__.keys() - type(self).model_fields.keys():
            del chosen.__dict__[cached]
        return chosen
