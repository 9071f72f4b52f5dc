"""Define `Problem`, the base class of every planner, and the values that its methods return.

A problem is a pydantic model whose fields are the fields of the problem file. Schema, validation and planner are
therefore one class: a file that validates is a problem that can be run.
"""

from __future__ import annotations

import json
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field

from genetics.arrays import Fitness, Genomes
from genetics.recipe import Recipe
from problems.errors import BadInput
from problems.plain_genomes import from_plain, to_plain
from problems.tables import RecipeName, Table, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from genetics.coding import Coding
    from genetics.operators import Operator
    from problems.animation import Animation
    from problems.motion import Motion, Pace
    from problems.run import Run

Solution = dict[str, Any]  # plain JSON values
Populations = Mapping[int, Genomes]  # generation to genomes, shape (n, genome_bytes)

CHECKED = {"checked": True}
"""Validation context: costly validators may skip their work, because another process has already done it."""

MOST_REPORT_BYTES = 1 << 12  # per cell; a thousand cells may report at the same time


@dataclass(frozen=True)
class Clearance:
    """The least distance between a solution and an obstacle, or anything else that it must not touch.

    Attributes:
        least: the least distance, in ``unit``. It is negative where bodies overlap, if the planner measures the depth,
            and +inf if there is nothing to come close to.
        where: which bodies are that close, and at which point of the solution, as plain JSON values such as
            ``{"configuration": [0.1, 0.2], "link": 2, "obstacle": 0}``.
        unit: the unit of ``least``; an empty string if the planner's space has no unit.
    """

    least: float
    where: dict[str, Any] = field(default_factory=dict)
    unit: str = "m"


@dataclass(frozen=True)
class Verdict:
    """The outcome of `Problem.check`.

    Attributes:
        fitness: the solution's fitness, computed independently of the code that found it.
        objections: the reasons why the solution is not acceptable, in words; empty if it is feasible.
        clearance: the solution's clearance as the check measured it; None if this kind of problem has none.
    """

    fitness: float
    objections: tuple[str, ...] = ()
    clearance: Clearance | None = None

    @property
    def feasible(self) -> bool:
        """Whether the check accepts the solution: there are no objections."""
        return not self.objections


@dataclass(frozen=True)
class Answer:
    """The result of `Problem.oracle`.

    Attributes:
        meaning: what ``fitness`` is: the ``"optimum"`` (over coded solutions or over all solutions, as ``method``
            says), or a ``"lower bound"`` or an ``"upper bound"`` of the optimum.
        fitness: the optimum or bound; +inf if there is certainly no feasible solution.
        method: how the value was obtained, in words.
        solution: a solution with that fitness, in the format of `Problem.decode`, if the method finds one.
        figures: further results by name, such as the fewest moves of any path.
    """

    meaning: Literal["optimum", "lower bound", "upper bound"]
    fitness: float
    method: str
    solution: Solution | None = None
    figures: Mapping[str, float | int | bool] = field(default_factory=dict)


class Problem(Table):
    """A problem to optimise: its fields, the coding of its individuals and their fitness.

    Fitness is minimised; +inf marks an infeasible individual and NaN is an error. A subclass declares the fields of
    its problem file and implements `coding` and `evaluate`. By default a solution holds the coded numbers; to give it a
    meaning of its own, override `decode` and `check`, always both. Every other member has a default.

    Every process of a cluster makes its own instance from the problem file, so all members must give the same results
    everywhere. Fields cannot be assigned; keep derived values in cached properties. For example::

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
    """One line that `supernode problems` shows for this kind."""
    template: ClassVar[str] = ""
    """A commented problem file, which `supernode init` writes."""

    is_batch_invariant: ClassVar[bool] = False
    """Whether `evaluate` returns bit-identical values however genomes are batched.

    Sums over rows do; matrix products do not. If True, the simulator evaluates all cells in one batch.
    """

    any_thread: ClassVar[bool] = False
    """Whether `evaluate` may be called on any thread, one call at a time. If True, small generations cost less."""

    oracle_decides: ClassVar[bool] = True
    """Whether the bounds of `oracle` hold for every solution, however `next_attempt` changes the coding.

    If True, a run ends as infeasible when the bound rules out the target, and as optimal when its champion reaches the
    bound. Set it to False where the oracle is only a reference: a value of the literature, or of fewer solutions.
    """

    oracle_may_rule_out: ClassVar[bool] = True
    """Whether `oracle` may find that there is no solution. If False, it is asked only once a run has stalled."""

    kind: str = Field(description="the kind of problem")

    @classmethod
    def __pydantic_init_subclass__(cls, **_: Any) -> None:
        """Reset `fitness_kernel` in a subclass that overrides `evaluate` or `coding` but not the kernel."""
        own = vars(cls)  # an inherited kernel would silently compute the fitness of the base class
        if "fitness_kernel" not in own and ("evaluate" in own or "coding" in own):
            cls.fitness_kernel = Problem.fitness_kernel  # type: ignore[method-assign]

    @classmethod
    def read_angles(cls, fields: dict[str, Any], world: Mapping[str, Any] | None = None) -> dict[str, Any]:
        """Return the fields of a problem file with all angles converted to radians.

        Called for built-in kinds where a file is read, before `gather`.

        Args:
            fields: plain values as written in the file, not yet validated.
            world: for an update, the fields of the problem that it changes; None for a problem file.

        Raises:
            BadInput: if an angle is out of range; the message names the field.
        """
        return fields

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Return the fields with the names of other files (maps, meshes, paths) replaced by those files' contents.

        Called once for built-in kinds, where a problem file is read. Afterwards no field names a file: nodes need no
        access to the file system, and the problem's digest covers the contents.

        Args:
            fields: plain values, not yet validated.
            folder: the problem file's folder, to which other file names are relative.

        Raises:
            BadInput: if a file cannot be read; the message names the field and the file.
        """
        return fields

    @classmethod
    def derive_fields(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """Return the fields plus derived fields that are costly to compute, so that nodes need not compute them again.

        Called for built-in kinds after `gather` and after each update; it reads no file. Wrong fields do not raise
        here: validation reports them.
        """
        return fields

    @property
    @abstractmethod
    def coding(self) -> Coding:
        """The coding of individuals, such as `BitString`. It is read often: make it a cached property."""

    @abstractmethod
    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the fitness of each genome: (n, genome_bytes) uint8 to (n,) float64.

        Lower is better, +inf is infeasible; NaN and -inf fail the job. The value depends on the genome alone.
        """

    @property
    def fitness_kernel(self) -> Operator | None:
        """`evaluate` as compiled code of signature `genetics.operators.FITNESS`, or None.

        With a kernel, a node breeds a whole generation in one compiled call. It must agree with `evaluate` bit for bit.
        """
        return None

    @property
    def solved_at(self) -> float | None:
        """The fitness at or below which a champion solves the problem; None if there is no such value."""
        return None

    @property
    def solved_when(self) -> str | None:
        """What `solved_at` means, as words that results print after its value; or why there is no such value."""
        return None

    @property
    def unreachable(self) -> str | None:
        """Why no solution can be as good as `solved_at`, as an error about a field; None if that is not known.

        Used for built-in kinds only. The file is refused before anything runs, unless the run sets its own target. The
        claim must therefore be certain, and cheap to compute: a closed form, not a search.
        """
        return None

    def next_attempt(self, attempt: int) -> dict[str, Any] | None:
        """Return the fields to change for the next attempt after a stall without reaching the target.

        It is called on the problem of the previous attempt. The next attempt starts with new individuals and another
        seed. The changes may alter how solutions are coded, but not what a solution is: fitness must stay comparable,
        and `check` of the unchanged problem must accept what is found. Every process calls this, some of them more than
        once, so it must be cheap and deterministic.

        Args:
            attempt: the number of the next attempt; 1 is the first restart.

        Returns:
            the fields to change, ``{}`` to try again unchanged, or None to make no further attempt.
        """
        return None

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return this problem with the fields that the file leaves to the recipe filled in, such as ``code``."""
        return self

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the genetic operators of the recipe ``name`` for demes of ``deme`` individuals."""
        from genetics.bit_string import BitString
        from genetics.permutation import Permutation

        if isinstance(self.coding, BitString):
            return Recipe("one-point", 1.0 / self.coding.length, "offspring" if name == "paper" else "elitist")
        if isinstance(self.coding, Permutation):
            return Recipe("order", 0.5, "elitist")
        return Recipe("blend", 0.1, "elitist")

    def decode(self, genome: Genomes) -> Solution:
        """Return the solution that a genome of shape (genome_bytes,) codes, as a dict of plain JSON values."""
        return to_plain(self.coding, genome)

    def for_cell(self) -> Self:
        """Return an instance for one cell; override it if `evaluate` keeps state, so that every cell has its own.

        State is for results worth reusing in later evaluations, such as a cache. No fitness may depend on it.
        """
        return self

    def report(self) -> bytes:
        """Return a summary of this cell's state when the cell stops, at most `MOST_REPORT_BYTES`."""
        return b""

    def merge(self, solution: Solution, reports: Mapping[int, bytes], finder: int) -> Solution:
        """Return the solution, completed with the reports of the cells.

        Args:
            solution: the result of `decode`.
            reports: non-empty reports by cell number.
            finder: the cell that found the solution.
        """
        return solution

    def describe(self, solution: Solution) -> str:
        """Return the solution in words, in one or a few lines."""
        return "\n".join(f"{name}: {json.dumps(value)}" for name, value in solution.items())

    def check(self, solution: Solution) -> Verdict:
        """Judge a solution, preferably without any code that `evaluate` uses. The default evaluates it again.

        Raises:
            BadInput: if ``solution`` does not have the format that `decode` returns.
        """
        try:
            genome = from_plain(self.coding, solution)
        except ValueError as error:
            raise BadInput(f"solution: {error}, for an individual of {self.kind}") from None
        fitness = float(self.evaluate(genome[None])[0])
        return Verdict(fitness, () if np.isfinite(fitness) else ("the individual is infeasible",))

    def oracle(self) -> Answer:
        """Return the optimum, or a bound of it, by an exact method that shares no code with `evaluate`.

        Raises:
            BadInput: if there is no such method for this problem.
        """
        raise BadInput(f"problems of kind {self.kind!r} have no oracle")

    def motion(self, solution: Solution, pace: Pace) -> Motion | None:
        """Return the solution as a motion over time, for `supernode export`; None if such solutions are no motions.

        Args:
            solution: a solution that `check` accepts.
            pace: speed and acceleration for paths without times, and the sampling rate.

        Raises:
            BadInput: if ``pace`` does not suit the solution.
        """
        return None

    def retimed(self, solution: Solution, pace: Pace) -> Solution:
        """Return a solution with the quickest motion along its path that keeps the robot's limits, for ``--retime``.

        `check` must judge the motion too, and `motion` return it.

        Args:
            solution: a solution that `check` accepts.
            pace: further limits of speed and acceleration, the sampling rate, and how far corners may be rounded.

        Raises:
            BadInput: if solutions of this kind are not retimed, or ``pace`` or the robot does not allow it.
        """
        raise BadInput(f"--retime: expected a kind whose paths can be retimed, found {self.kind!r}")

    def animation(self, solution: Solution | None) -> Animation | None:
        """Return the solution as bodies that move in space, for screens; None if it is no such motion.

        Args:
            solution: the result of `decode`; None for the problem alone.
        """
        return None

    def advice(self, found: Solution | None, run: Run) -> list[str]:
        """Return hints for a run that has stalled, one line each: a setting, a value to try and the current value.

        Args:
            found: the best solution found, feasible or not, in the format of `decode`; None if there is none.
            run: the settings of the run.
        """
        from problems.advice import advice_on_run

        return [advice_on_run(run)]

    def draw(self, figure: Figure, solution: Solution | None, populations: Populations) -> None:
        """Draw the problem, and the solution if there is one, onto an empty figure.

        Args:
            figure: an empty figure; its size may be changed.
            solution: the result of `decode`; None if nothing was found.
            populations: all individuals of the cluster at some generations, to show how they converge.

        Raises:
            BadInput: if this kind of problem has no picture.
        """
        raise BadInput(f"problems of kind {self.kind!r} have no picture")


class CodedProblem(Problem):
    """A problem whose individuals are bit-coded integers; the file or the recipe chooses binary or Gray code."""

    code: Literal["binary", "gray"] | None = quantity(
        "", 'how an integer is written in bits; if not given, the recipe\'s: tuned "gray", paper "binary"', default=None
    )

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Return this problem with a code: the file's, else binary for the paper's recipe and Gray for the tuned."""
        return self.filled_in(code="gray" if name == "tuned" else "binary")

    def filled_in(self, **choices: Any) -> Self:
        """Return this problem with the fields that are None set to ``choices``; fields set in the file are kept."""
        left_open = {name: choice for name, choice in choices.items() if getattr(self, name) is None}
        if not left_open:
            return self
        # Not validated again: no validator looks at these fields, and a thousand nodes would wait for it.
        chosen = self.model_copy(update=left_open)
        # The copy shares the cached properties of the original, which may depend on the fields just set.
        for cached in chosen.__dict__.keys() - type(self).model_fields.keys():
            del chosen.__dict__[cached]
        return chosen
