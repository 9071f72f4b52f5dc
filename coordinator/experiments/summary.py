"""Compute numbers with intervals from the runs: the costs of each point, and its speed-ups.

Speed-ups are named after Alba's taxonomy (Alba 2002, "Parallel evolutionary algorithms can achieve super-linear
performance", Information Processing Letters 82:7-13). *Strong*: the cost of the best sequential algorithm known here,
divided by the cost on n nodes. *Weak, orthodox*: the cost of the same algorithm of n cells on one processor, divided by
the cost on n nodes. Alba's weak speed-up against panmixia (one population without structure) equals the strong one here
wherever the sequential deme is the best.

A cost is counted in evaluations (on the critical path: all evaluations divided by the nodes) or in CPU seconds (on the
critical path: of the node that used most). Only evaluations compare searches. In a strong speed-up a run that did not
reach the target costs more than any run that did.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from statistics import median as middle
from typing import Any

from coordinator.experiments import statistics
from coordinator.experiments.comparison import Comparison, compare, first_of
from coordinator.experiments.experiment import Case, Parameters, Point, Series, points, sequential_cases
from coordinator.experiments.journal import Journal, Record
from coordinator.experiments.statistics import Estimate


@dataclass(frozen=True)
class Metric:
    """A number that is computed for each point.

    Attributes:
        name: its name in tables.
        label: its name for people.
        unit: its unit; empty if it has none.
        statistic: "median", "mean", "rate of success", "sum" or "ratio of medians".
        of: returns a run's value; None if the run has none.
    """

    name: str
    label: str
    unit: str
    statistic: str
    of: Callable[[Record], float | None] = lambda _: None


def _per_node_and_generation(name: str, scale: float = 1.0) -> Callable[[Record], float | None]:
    return lambda run: _quotient(scale * run[name], run["nodes"] * run["generations"])


def _per_second(name: str) -> Callable[[Record], float | None]:
    return lambda run: _quotient(run[name], run["seconds"])


def _if_solved(name: str) -> Callable[[Record], float | None]:
    return lambda run: run[name] if run["solved"] else None


def _quotient(value: float, divisor: float) -> float | None:
    return value / divisor if divisor else None


SUCCESS = Metric("success_rate", "runs that reached the target", "", "rate of success")
TO_TARGET = (
    Metric("seconds_to_target", "time to target", "s", "median", _if_solved("seconds_to_target")),
    Metric(
        "evaluations_to_target", "evaluations to target, all nodes", "", "median", _if_solved("evaluations_to_target")
    ),
    Metric("evaluations_to_stop", "evaluations to the agreed stop, all nodes", "", "median", _if_solved("evaluations")),
    Metric(
        "critical_cpu_seconds", "critical-path CPU time to the stop", "s", "median", _if_solved("critical_cpu_seconds")
    ),
)
PER_GENERATION = (
    Metric("generations_per_second", "generations/s", "", "mean", _per_second("generations")),
    Metric("evaluations_per_second", "evaluations/s", "", "mean", _per_second("evaluations")),
    Metric(
        "cpu_per_node_and_generation",
        "CPU per node and generation",
        "µs",
        "mean",
        _per_node_and_generation("node_cpu_seconds", 1e6),
    ),
    Metric(
        "messages_sent_per_node_and_generation",
        "messages sent per node and generation",
        "",
        "mean",
        _per_node_and_generation("messages_sent"),
    ),
    Metric(
        "messages_received_per_node_and_generation",
        "messages received per node and generation",
        "",
        "mean",
        _per_node_and_generation("messages_received"),
    ),
    Metric("messages_lost", "messages lost, all runs", "", "sum", lambda run: run["messages_lost"]),
    Metric("staleness", "staleness of immigrants", "generations", "mean", lambda run: run["staleness_mean"]),
)
FITNESS = Metric(
    "fitness", "best fitness", "", "median", lambda run: math.inf if run["fitness"] is None else run["fitness"]
)
LAUNCH = Metric("launch_seconds", "launch time", "s", "mean")
MEMORY = Metric("memory_per_node", "memory per node, PSS", "MB", "mean")

STRONG_EVALUATIONS = Metric("strong_speedup_evaluations", "strong speed-up, in evaluations", "×", "ratio of medians")
STRONG_CPU = Metric(
    "strong_speedup_cpu", "CPU time of the best sequential program over the critical path", "×", "ratio of medians"
)
INDEPENDENT = Metric(
    "independent_speedup", "speed-up of n independent sequential runs, in evaluations", "×", "ratio of medians"
)
WEAK_TWIN = Metric("weak_speedup_twin", "CPU time of the simulator over the critical path", "×", "median")
WEAK_BALANCE = Metric("weak_speedup_balance", "CPU time of all nodes over the critical path", "×", "median")
SPEEDUPS = (STRONG_EVALUATIONS, INDEPENDENT, STRONG_CPU, WEAK_TWIN, WEAK_BALANCE)


@dataclass(frozen=True)
class Curve:
    """Points that differ only in their number of nodes."""

    series: Series
    mode: str
    deme: int | None  # None if it is a node's share of a fixed population

    @property
    def name(self) -> str:
        """The name in tables and legends."""
        return f"{self.series}, {self.mode}" if self.deme is None else f"{self.series}, {self.mode}, deme {self.deme}"


@dataclass(frozen=True)
class Row:
    """One number of one point; without a curve and a deme, of a number of nodes."""

    curve: Curve | None
    nodes: int
    deme: int | None
    metric: Metric
    estimate: Estimate
    comparison: Comparison | None = None  # the verdict; only of strong speed-ups in evaluations

    @property
    def efficiency(self) -> Estimate:
        """The efficiency, if this is a speed-up: the speed-up divided by the nodes."""
        return self.estimate.divided_by(self.nodes)

    @property
    def is_super_linear(self) -> bool:
        """Whether this is a speed-up, and the whole interval of its efficiency is above 1."""
        return self.metric in SPEEDUPS and self.metric is not INDEPENDENT and self.efficiency.is_above(1.0)


@dataclass(frozen=True)
class Sequential:
    """The sequential algorithm with one size of deme."""

    deme: int
    success: Estimate
    evaluations: Estimate | None  # to the target; infinite for failures
    cpu_seconds: Estimate | None  # likewise
    fitness: Estimate | None  # reached within the budget
    best_for: tuple[str, ...] = ()  # the costs by which it is the best: "evaluations", "CPU time"


@dataclass(frozen=True)
class Summary:
    """Everything that tables, plots and the report show.

    Attributes:
        parameters: the parameters of the experiment.
        rows: the numbers of all points and sizes.
        sequential: the sequential algorithm, by deme.
        runs: the latest record of each run, failed ones included.
        failed: the runs that failed because the cluster or the problem broke; no number includes them.
        replayed: how many lockstep runs have the same history as their twin, and how many have a twin.
    """

    parameters: Parameters
    rows: list[Row]
    sequential: list[Sequential]
    runs: list[Record]
    failed: list[Record]
    replayed: tuple[int, int]

    def curves(self, *series: str) -> list[Curve]:
        """Return the curves of some series, or of all, in order."""
        found = dict.fromkeys(row.curve for row in self.rows if row.curve is not None)
        return [curve for curve in found if not series or curve.series in series]

    def find(self, metric: Metric, curve: Curve | None = None, nodes: int | None = None) -> list[Row]:
        """Return the rows of a metric: of a curve, or (None) of sizes; for all numbers of nodes, or for one."""
        return [
            row
            for row in self.rows
            if row.metric == metric and row.curve == curve and (nodes is None or row.nodes == nodes)
        ]

    def super_linear(self) -> list[Row]:
        """Return every speed-up whose whole interval exceeds the number of nodes."""
        return [row for row in self.rows if row.is_super_linear]


def summarise(parameters: Parameters, journal: Journal) -> Summary:
    """Return the numbers of all runs in the journal."""
    runs = _Runs(journal.runs)
    return Summary(
        parameters=parameters,
        rows=[*_sizes(parameters, journal), *_rows(parameters, runs), *_strong(parameters, runs)],
        sequential=list(_sequential(parameters, runs)),
        runs=list(journal.runs.values()),
        failed=[run for run in journal.runs.values() if run["status"] == "failed"],
        replayed=_replayed(parameters, runs),
    )


class _Runs:
    """The runs that have not failed, by case."""

    def __init__(self, runs: dict[str, Record]) -> None:
        self._runs = {key: run for key, run in runs.items() if run["status"] != "failed"}

    def of(self, cases: Iterable[Case]) -> list[Record]:
        return [self._runs[case.key] for case in cases if case.key in self._runs]

    def at(self, point: Point, repeats: int) -> list[Record]:
        return self.of(point.case(seed) for seed in range(1, repeats + 1))

    def pairs(self, point: Point, repeats: int) -> list[tuple[Record, Record]]:
        """Return each run of a point with its twin."""
        keys = [(point.case(seed).key, point.case(seed, "twin").key) for seed in range(1, repeats + 1)]
        return [(self._runs[one], self._runs[two]) for one, two in keys if one in self._runs and two in self._runs]


# Sizes and points -----------------------------------------------------------------------------------------------------
def _sizes(parameters: Parameters, journal: Journal) -> Iterator[Row]:
    """Yield the time of a launch and the memory of a node for each number of nodes."""
    for nodes in parameters.nodes:
        seconds = [record["seconds"] for record in journal.of_type("launch") if record["nodes"] == nodes]
        memory = [record["bytes"] / 1e6 for record in journal.of_type("memory") if record["nodes"] == nodes]
        for metric, values in ((LAUNCH, seconds), (MEMORY, memory)):
            estimate = statistics.mean(values)
            if estimate is not None:
                yield Row(None, nodes, None, metric, estimate)


def _rows(parameters: Parameters, runs: _Runs) -> Iterator[Row]:
    for point in points(parameters):
        curve = _curve_of(point)
        for metric, estimate in _estimates(parameters, point, runs):
            if estimate is not None:
                yield Row(curve, point.nodes, point.deme, metric, estimate)


def _curve_of(point: Point) -> Curve:
    return Curve(point.series, point.mode, None if point.series == "fixed-population" else point.deme)


def _estimates(parameters: Parameters, point: Point, runs: _Runs) -> Iterator[tuple[Metric, Estimate | None]]:
    """Yield every metric of a point, except strong speed-ups, which are judged together."""
    its_runs = runs.at(point, parameters.repeats)
    yield SUCCESS, statistics.proportion(sum(run["solved"] for run in its_runs), len(its_runs))
    to_target = TO_TARGET if point.goal == "target" else ()
    for metric in (*to_target, FITNESS, *PER_GENERATION):
        yield metric, _estimate(metric, its_runs)
    if point.goal == "target":
        yield from _weak(parameters, point, its_runs, runs)


def _estimate(metric: Metric, runs: Sequence[Record]) -> Estimate | None:
    values = [value for value in map(metric.of, runs) if value is not None]
    if metric.statistic == "median":
        return statistics.median(values)
    if metric.statistic == "mean":
        return statistics.mean(values)
    return Estimate(sum(values), None, None, len(values)) if values else None


def _compared(parameters: Parameters, runs: _Runs) -> dict[Point, Comparison]:
    """Compare all points with the best sequential algorithm, in evaluations, at once.

    Lockstep points use their twins: these need the same evaluations, and there are more seeds of them.
    """
    of_target = [point for point in points(parameters) if point.goal == "target"]
    seeds = range(1, max(parameters.repeats, parameters.seeds) + 1)
    costs = []
    for point in of_target:
        its_runs = runs.of(point.case(seed, "twin" if point.has_twin else "nodes") for seed in seeds)
        costs.append([evaluations_on_path(run) * point.nodes for run in its_runs])
    sequential = [_sequential_runs(parameters, runs, deme, "target") for deme in parameters.sequential]
    alone = [[evaluations_on_path(run) for run in those] for those in sequential if those]
    return dict(zip(of_target, compare(alone, costs), strict=True))


def _strong(parameters: Parameters, runs: _Runs) -> Iterator[Row]:
    """Yield the strong speed-ups of all points, and those that independent sequential runs would have."""
    best = {cost: _best_sequential(parameters, runs, cost) for cost in (evaluations_on_path, cpu_on_path)}
    alone = [evaluations_on_path(run) for run in best[evaluations_on_path]]
    for point, comparison in _compared(parameters, runs).items():
        place = (_curve_of(point), point.nodes, point.deme)
        if comparison.efficiency is not None:
            estimate = comparison.efficiency.divided_by(1 / point.nodes)
            yield Row(*place, STRONG_EVALUATIONS, estimate, comparison)
            first = first_of(alone, point.nodes)
            yield Row(*place, INDEPENDENT, Estimate(middle(alone) / first, None, None, len(alone)))
        its_runs = runs.at(point, parameters.repeats)
        above, below = ([cpu_on_path(run) for run in those] for those in (best[cpu_on_path], its_runs))
        if (estimate_of_cpu := statistics.ratio_of_medians(above, below)) is not None:
            yield Row(*place, STRONG_CPU, estimate_of_cpu)


def _weak(
    parameters: Parameters, point: Point, its_runs: Sequence[Record], runs: _Runs
) -> Iterator[tuple[Metric, Estimate | None]]:
    """Yield the weak speed-ups of a point: ratios of CPU times, run by run."""
    if point.has_twin:
        pairs = runs.pairs(point, parameters.repeats)
        ratios = [twin["cpu_seconds"] / run["critical_cpu_seconds"] for run, twin in pairs]
        yield WEAK_TWIN, statistics.median(ratios)
    balance = [run["node_cpu_seconds"] / run["critical_cpu_seconds"] for run in its_runs]
    yield WEAK_BALANCE, statistics.median(balance)


def evaluations_on_path(run: Record) -> float:
    """Return the evaluations of one node up to the stop; infinite if the target was not reached."""
    return float(run["evaluations"]) / run["nodes"] if run["solved"] else math.inf


def cpu_on_path(run: Record) -> float:
    """Return the CPU seconds of the node that used most, up to the stop; infinite if the target was not reached."""
    return float(run["critical_cpu_seconds"]) if run["solved"] else math.inf


# The sequential algorithm ---------------------------------------------------------------------------------------------
def _sequential_runs(parameters: Parameters, runs: _Runs, deme: int, goal: str) -> list[Record]:
    return runs.of(case for case in sequential_cases(parameters) if (case.deme, case.goal) == (deme, goal))


def _best_sequential(parameters: Parameters, runs: _Runs, cost: Callable[[Record], float]) -> list[Record]:
    """Return the runs of the deme that reached the target most often; among equals, those of the least median cost."""

    def merit(those: list[Record]) -> tuple[int, float]:
        return -sum(run["solved"] for run in those), middle([cost(run) for run in those]) if those else math.inf

    return min((_sequential_runs(parameters, runs, deme, "target") for deme in parameters.sequential), key=merit)


def _sequential(parameters: Parameters, runs: _Runs) -> Iterator[Sequential]:
    costs = {"evaluations": evaluations_on_path, "CPU time": cpu_on_path}
    best = {name: _best_sequential(parameters, runs, cost) for name, cost in costs.items()}
    for deme in parameters.sequential:
        its_runs = _sequential_runs(parameters, runs, deme, "target")
        with_budget = _sequential_runs(parameters, runs, deme, "budget")
        success = statistics.proportion(
            sum(run["solved"] for run in its_runs or with_budget), len(its_runs or with_budget)
        )
        if success is not None:
            yield Sequential(
                deme,
                success,
                statistics.median([evaluations_on_path(run) for run in its_runs]),
                statistics.median([cpu_on_path(run) for run in its_runs]),
                _estimate(FITNESS, with_budget),
                tuple(name for name, those in best.items() if its_runs and those == its_runs),
            )


def _replayed(parameters: Parameters, runs: _Runs) -> tuple[int, int]:
    pairs: dict[str, tuple[Any, Any]] = {}
    for point in points(parameters):
        if point.has_twin:
            for run, twin in runs.pairs(point, parameters.repeats):
                pairs[run["key"]] = (run["history_sha256"], twin["history_sha256"])
    return sum(one == two for one, two in pairs.values()), len(pairs)
