"""The settings of a run: the ``[run]`` table of a problem file, and the options of the commands."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, Protocol

from pydantic import Field, field_validator, model_validator

import topologies
from genetics.recipe import Recipe, Replacement, evaluations_per_generation
from problems.tables import RecipeName, Table

DEFAULT_STALL = 200  # generations
DEFAULT_RESTARTS = 8  # of a run that nothing else limits
MOST_DEME = 1 << 16
MOST_GENERATIONS = 1 << 31

Count = Annotated[int, Field(ge=0, lt=MOST_GENERATIONS)]


class HasRecipe(Protocol):
    """What a run needs of a problem: its genetic operators. `problems.problem.Problem` itself depends on `Run`."""

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the genetic operators of the recipe ``name`` for demes of ``deme`` individuals."""


def with_topology(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with the shorthand ``torus`` replaced by the ``topology`` that it stands for.

    Args:
        settings: settings by name; ``torus`` may be "RxC" or a pair (rows, columns).

    Raises:
        ValueError: if the torus is invalid or a topology is given, too; the message begins with the field.
    """
    others = {name: value for name, value in settings.items() if name != "torus"}
    if settings.get("torus") is None:
        return others
    if others.get("topology") is not None:
        raise ValueError(f"torus: expected either a torus or a topology, found both ({others['topology']!r})")
    try:
        return others | {"topology": topologies.torus_spec(settings["torus"])}
    except ValueError as error:
        raise ValueError(f"torus: {error}") from None


class Run(Table):
    """The settings of a run. A limit that is None does not end the run."""

    shorthands: ClassVar[tuple[str, ...]] = ("torus",)  # names that `with_topology` replaces before validation

    topology: str = Field("torus 4x4", description="which cells are neighbours")
    deme: int = Field(1, ge=1, le=MOST_DEME, description="individuals on each node")
    interval: int = Field(1, ge=1, lt=MOST_GENERATIONS, description="generations between two exchanges")
    emigrants: int = Field(1, ge=1, le=MOST_DEME, description="individuals sent in an exchange")
    mode: Literal["lockstep", "async"] = Field("lockstep", description="wait for neighbours, or do not")
    recipe: RecipeName = Field("tuned", description="the paper's operators, or those that performed best here")
    replacement: Replacement | None = Field(None, description="instead of the recipe's")
    mutation: Annotated[float, Field(ge=0, le=1)] | Literal["one-bit"] | None = Field(
        None, description="probability that a bit changes, instead of the recipe's"
    )
    spy: Literal["champion", "root"] = Field("champion", description="which news reaches the root cell")
    seed: int = Field(1, ge=0, lt=1 << 64, description="the same seed gives the same run")
    generations: Count | None = Field(None, description="end after this generation")
    evaluations: Count | None = Field(None, description="end before this many fitness calls are exceeded")
    seconds: Annotated[float, Field(gt=0)] | None = Field(None, description="deadline, s")
    target: float | None = Field(None, description="fitness that ends the run, instead of the problem's own")
    keep_alive: bool = Field(False, description="stay after the end, for the next update of the world")
    grow: bool = Field(False, description="take further rows of the torus when a running cluster has nodes free")
    stall: Annotated[int, Field(ge=1, lt=MOST_GENERATIONS)] | None = Field(
        None, description="end, or restart, after this many generations without a better champion"
    )
    oracle: bool = Field(True, description="ask the problem's oracle, if it has one, whether a solution exists")
    restarts: Count | None = Field(None, description="restart at most so often after a stall without an answer")

    @field_validator("topology")
    @classmethod
    def _known_topology(cls, spec: str) -> str:
        return topologies.parse(spec).spec  # in its canonical form, so that equal topologies compare equal

    @model_validator(mode="after")
    def _emigrants_live_in_the_deme(self) -> "Run":
        if self.emigrants > self.deme:
            raise ValueError(f"emigrants: expected at most the deme, {self.deme}, found {self.emigrants}")
        return self

    @model_validator(mode="after")
    def _only_a_torus_grows(self) -> "Run":
        if self.grow and not isinstance(topologies.parse(self.topology), topologies.Torus):
            raise ValueError(f"grow: expected a torus, which takes further rows, found {self.topology!r}")
        return self

    @property
    def is_limited(self) -> bool:
        """Whether a limit of generations, evaluations or seconds certainly ends the run."""
        return not (self.generations is None and self.evaluations is None and self.seconds is None)

    def stall_limit(self) -> int | None:
        """Return the number of generations without a better champion that ends the run, or None.

        The default applies only to runs that nothing else would end.
        """
        return DEFAULT_STALL if self.stall is None and not self.is_limited else self.stall

    def breeding(self, problem: HasRecipe) -> Recipe:
        """Return the problem's recipe, with the mutation and replacement of this run if it sets them."""
        base = problem.recipe(self.recipe, self.deme)
        return replace(
            base,
            mutation=base.mutation if self.mutation is None else self.mutation,
            replacement=self.replacement or base.replacement,
        )

    def last_generation(self, recipe: Recipe, epochs: int = 1) -> int | None:
        """Return the last generation of the job that the limits allow, or None if they allow any number.

        All cells make the same number of evaluations per generation, so a limit of evaluations is a limit of
        generations, which every cell can apply without communication.

        Args:
            recipe: the recipe, which decides how many evaluations a generation takes.
            epochs: the number of epochs of the job; each also evaluates a first population.
        """
        limits = [] if self.generations is None else [self.generations]
        if self.evaluations is not None:
            topology = topologies.parse(self.topology)
            slots = len(topology.neighbours(0))  # the same for all cells: each has as many slots
            first = epochs * topology.cells * self.deme
            each = topology.cells * evaluations_per_generation(self.deme, slots, recipe)
            # Rounded down: the limit is never exceeded, not even by a part of a generation.
            limits.append(max(0, (self.evaluations - first) // each))
        return min(limits, default=None)
