"""The design of a scaling experiment: its parameters, and the runs that follow from them.

Three series ask three questions; a run that two of them need is made once:

- *growing-population* (weak scaling): the deme on a node is fixed, so the population grows with the nodes; runs end at
  the target;
- *fixed-population* (strong scaling): the whole population is fixed and divided among the nodes; runs end at the
  target;
- *budget*: the deme on a node is fixed, and so are the evaluations of all nodes together; the best fitness counts.

There are two references: the *sequential* algorithm, one deme in one process without neighbours; and the *twin* of a
lockstep run, the same run of the same cells, bit for bit, on one processor without messages.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Literal

from node.plan import Plan
from problems import BadInput, ProblemFile, Run
from topologies import torus_of

Mode = Literal["lockstep", "async"]
Series = Literal["fixed-population", "growing-population", "budget"]
Goal = Literal["target", "budget"]
Role = Literal["nodes", "twin", "sequential"]

MODES: tuple[Mode, ...] = ("lockstep", "async")
SERIES: tuple[Series, ...] = ("fixed-population", "growing-population", "budget")
MOST_NODES = 4096  # each is a process

_OWN = ("topology", "deme", "mode", "seed", "evaluations", "restarts")  # settings that the experiment decides
_OF_NODES_ONLY = (
    "generations",
    "stall",
    "interval",
    "emigrants",
)  # settings that mean nothing, or something else, for the single deme of the sequential algorithm
_BUDGET_PER_INDIVIDUAL = 128
_LIMIT_PER_INDIVIDUAL = 1024
_LEAST_BUDGET_GENERATIONS = 8


@dataclass(frozen=True)
class Parameters:
    """The parameters of an experiment; `design` makes and checks them.

    Attributes:
        nodes: the numbers of nodes, ascending; each is a size of the torus.
        repeats: the number of runs of each kind on nodes, with seeds 1, 2, ...
        seeds: the number of runs of each kind in one process; verdicts on the search rest on these.
        modes: the modes to run in.
        demes: the sizes of a node's deme, in the growing-population and budget series.
        series: the series to run.
        population: the population of all nodes together, in the fixed-population series.
        budget: the evaluations of all nodes together in a run of the budget series.
        evaluations: the limit of evaluations of all nodes together in a run to the target.
        sequential: the deme sizes of the sequential algorithm; the best one counts.
        launches: how often to launch a cluster of each size, to measure the time of a launch.
        run: further settings of every run.
    """

    nodes: tuple[int, ...]
    repeats: int
    seeds: int
    modes: tuple[Mode, ...]
    demes: tuple[int, ...]
    series: tuple[Series, ...]
    population: int
    budget: int
    evaluations: int
    sequential: tuple[int, ...]
    launches: int
    run: dict[str, Any]

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values."""
        return {name: list(value) if isinstance(value, tuple) else value for name, value in asdict(self).items()}

    @property
    def goals(self) -> tuple[Goal, ...]:
        """The goals of the series, without repeats."""
        return tuple(dict.fromkeys(goal_of(series) for series in self.series))

    def limit(self, goal: Goal) -> int:
        """Return the evaluations of all nodes together at which a run ends."""
        return self.budget if goal == "budget" else self.evaluations


@dataclass(frozen=True)
class Case:
    """One run of the experiment."""

    role: Role
    nodes: int
    mode: Mode
    deme: int
    goal: Goal
    seed: int

    @property
    def key(self) -> str:
        """The name of the run in the journal, unique within an experiment."""
        return f"{self.role} {self.nodes} {self.mode} deme {self.deme} to {self.goal} seed {self.seed}"

    def settings(self, parameters: Parameters) -> dict[str, Any]:
        """Return the run's settings, as in the ``[run]`` table of a problem file."""
        left_out = _OF_NODES_ONLY if self.role == "sequential" else ()
        return {name: value for name, value in parameters.run.items() if name not in left_out} | {
            "topology": torus_of(self.nodes),
            "deme": self.deme,
            "mode": self.mode,
            "seed": self.seed,
            "evaluations": parameters.limit(self.goal),
            "restarts": 0,
        }

    def file(self, file: ProblemFile, parameters: Parameters) -> ProblemFile:
        """Return the problem file with the settings of this run instead of its own.

        Raises:
            BadInput: if the settings do not fit together.
        """
        return replace(file, run=Run.model_validate({})).with_run(**self.settings(parameters))


@dataclass(frozen=True)
class Point:
    """A point of a curve: runs that differ only in their seed."""

    series: Series
    mode: Mode
    nodes: int
    deme: int

    @property
    def goal(self) -> Goal:
        """The goal at which its runs end."""
        return goal_of(self.series)

    @property
    def has_twin(self) -> bool:
        """Whether twins of its runs are made: only lockstep runs can be repeated bit for bit."""
        return self.mode == "lockstep" and self.goal == "target"

    def case(self, seed: int, role: Role = "nodes") -> Case:
        """Return the run of that seed."""
        return Case(role, self.nodes, self.mode, self.deme, self.goal, seed)


def goal_of(series: Series) -> Goal:
    """Return the goal at which the runs of a series end."""
    return "budget" if series == "budget" else "target"


def points(parameters: Parameters) -> list[Point]:
    """Return every point of every curve, curve by curve."""
    return [
        Point(series, mode, nodes, parameters.population // nodes if series == "fixed-population" else deme)
        for series in parameters.series
        for mode in parameters.modes
        for deme in (parameters.demes if series != "fixed-population" else (0,))
        for nodes in parameters.nodes
    ]


def cases_on(parameters: Parameters, nodes: int, role: Role = "nodes") -> list[Case]:
    """Return the runs of one size, seed by seed, so that an interrupted experiment has some runs of each kind."""
    wanted = [point for point in points(parameters) if point.nodes == nodes and (role == "nodes" or point.has_twin)]
    return list(dict.fromkeys(point.case(seed, role) for seed in _seeds(parameters, role) for point in wanted))


def sequential_cases(parameters: Parameters) -> list[Case]:
    """Return the runs of the sequential algorithm, seed by seed."""
    return [
        Case("sequential", 1, "lockstep", deme, goal, seed)
        for seed in _seeds(parameters, "sequential")
        for deme in parameters.sequential
        for goal in parameters.goals
    ]


def all_cases(parameters: Parameters) -> Iterator[Case]:
    """Yield all runs in the order in which they are made."""
    yield from sequential_cases(parameters)
    for nodes in parameters.nodes:
        yield from cases_on(parameters, nodes)
        yield from cases_on(parameters, nodes, "twin")


def _seeds(parameters: Parameters, role: Role) -> range:
    return range(1, (parameters.repeats if role == "nodes" else max(parameters.repeats, parameters.seeds)) + 1)


def design(
    file: ProblemFile,
    *,
    nodes: Sequence[int] = (16, 64),
    repeats: int = 5,
    seeds: int = 100,
    modes: Sequence[Mode] = MODES,
    demes: Sequence[int] | None = None,
    series: Sequence[Series] = SERIES,
    population: int | None = None,
    budget: int | None = None,
    evaluations: int | None = None,
    sequential: Sequence[int] = (16, 64, 256),
    launches: int = 1,
    **run: Any,
) -> Parameters:
    """Return the checked parameters of an experiment; a parameter that is None gets a value that suits the others.

    See `Parameters` for their meanings; ``run`` replaces settings of the file's ``[run]`` table.

    Raises:
        BadInput: if a parameter is wrong; the message names it.
    """
    settings = _settings(file, run)
    own_demes = tuple(sorted(set((file.run.deme,) if demes is None else demes)))
    _check_range("nodes", nodes, MOST_NODES)
    _check_range("demes", own_demes)
    _check_range("sequential", sequential)
    whole_numbers = {"population": population, "budget": budget, "evaluations": evaluations}
    for name, value in {"repeats": repeats, "seeds": seeds, "launches": launches, **whole_numbers}.items():
        _check_range(name, (1 if value is None else value,))
    whole = population or math.lcm(*nodes) * own_demes[0]
    parameters = Parameters(
        nodes=tuple(sorted(set(nodes))),
        repeats=repeats,
        seeds=seeds,
        modes=tuple(dict.fromkeys(modes)),
        demes=own_demes,
        series=tuple(dict.fromkeys(series)),
        population=whole,
        budget=budget or _default_budget(whole, max(nodes) * own_demes[-1]),
        evaluations=evaluations or file.run.evaluations or _LIMIT_PER_INDIVIDUAL * whole,
        sequential=tuple(sorted(set(sequential))),
        launches=launches,
        run=settings,
    )
    _check(file, parameters)
    return parameters


def _settings(file: ProblemFile, run: dict[str, Any]) -> dict[str, Any]:
    """Return the file's settings, replaced by those given, without settings that the experiment decides."""
    given = {name: value for name, value in run.items() if value is not None}
    own = file.run.model_dump(exclude_unset=True, exclude_none=True)
    return {name: value for name, value in (own | given).items() if name not in _OWN}


def _default_budget(population: int, largest: int) -> int:
    return max(_BUDGET_PER_INDIVIDUAL * population, _LEAST_BUDGET_GENERATIONS * largest)


def _check_range(name: str, values: Sequence[int], most: int | None = None) -> None:
    if not values:
        raise BadInput(f"--{name}: expected at least one, found none")
    for value in values:
        if value < 1 or (most is not None and value > most):
            upper = "" if most is None else f" to {most}"
            raise BadInput(f"--{name}: expected whole numbers from 1{upper}, found {value}")


def _check(file: ProblemFile, parameters: Parameters) -> None:
    """Check everything that can be checked before the first process is launched, since an experiment takes hours."""
    if "fixed-population" in parameters.series:
        _check_division(parameters)
    for case in all_cases(parameters):
        if case.seed == 1:  # the other seeds make runs of the same settings
            _check_limit(case, parameters)
            _check_target(case, case.file(file, parameters))


def _check_division(parameters: Parameters) -> None:
    for nodes in parameters.nodes:
        if parameters.population % nodes:
            raise BadInput(f"--population: expected a multiple of {nodes} nodes, found {parameters.population}")


def _check_target(case: Case, file: ProblemFile) -> None:
    if Plan.of(file).target is None and case.goal == "target":
        raise BadInput(f"{file.name}: expected a problem with a target, found none; give --target, or --series budget")


def _check_limit(case: Case, parameters: Parameters) -> None:
    limit, first = parameters.limit(case.goal), case.nodes * case.deme
    if limit < first:
        option = "budget" if case.goal == "budget" else "evaluations"
        raise BadInput(f"--{option}: expected at least the first generation of {case.key}, {first}, found {limit}")
