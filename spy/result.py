"""The result of a job, as `--json` prints it and Python users get it."""

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

import topologies
from problems import Run
from spy.judgement import Judgement, Status
from spy.past import Lived, Past, stopped_after
from topologies import Topology
from wire.news import Improvement
from wire.report import Reason, Report, Staleness

# Reasons that do not follow from the seed: a replay needs to know when the run was stopped for one of them.
_FROM_OUTSIDE: tuple[Reason, ...] = ("deadline", "cancel", "infeasible")


@dataclass(frozen=True)
class Result:
    """The outcome of a job.

    Attributes:
        job: the job's name.
        kind: the kind of the problem.
        status: "solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled" or "failed".
        solved: whether the target was reached.
        feasible: whether the planner's independent check accepts what was found.
        fitness: the fitness of the solution, or without one of the best attempt; +inf if there is neither.
        solution: the solution as the planner's own plain values; None unless the check accepts them.
        found_at: cell and generation of the birth of the solution, or of the best attempt.
        generations: the generation after which all cells stopped; in async mode the median over cells.
        evaluations: the number of fitness calls of all nodes.
        seconds: seconds from the start to the last stop.
        seconds_to_ready: seconds from the call until the cluster was ready.
        cpu_seconds: processor time of all processes.
        nodes: the number of nodes.
        topology: the topology, as text.
        deme: the number of individuals on each node.
        mode: "lockstep" or "async".
        seed: the seed of the run.
        run: the settings of the first epoch; `directives` say what came after it. All other fields are of the last one.
        problem_sha256: the digest of the problem file.
        versions: versions and processor of the nodes, see `node.fingerprint`.
        directives: the changes and stops that a replay repeats, and after which generation each took effect.
        messages: how many messages were sent, received, lost and rejected.
        staleness: in async mode, how many generations the immigrants bred with were behind their cells (mean, max), and
            the share of them that had been bred with before (again); None in lockstep, where all are of one generation.
        history_sha256: equal for equal lockstep runs; None if the run failed, or part of its history is unknown.
        message: why the run failed, or the check's objections to the solution.
        target: the fitness that counts as solved, if there is one.
        clearance: how close the solution, or the best attempt, comes to what it must not touch: the ``"least"``
            distance (None if there is nothing to come close to), ``"where"`` that is, what was ``"required"``, and the
            ``"unit"`` of both; None if problems of this kind have no clearance.
        best_attempt: the best that was found, in the form of a solution, if the check does not accept it; else None.
        solved_when: what the target means, in words, or why there is none.
        oracle: what an exact method says, in words: that there is no solution, or that this is the optimum, or what the
            optimum is; None if there is no such method, or it did not finish.
        advice: settings to change if the run has stalled, one line each.
        words: the solution in words.
        demes: the last individuals of each cell, for pictures.
    """

    job: str
    kind: str
    status: Status
    solved: bool
    feasible: bool
    fitness: float
    solution: dict[str, Any] | None
    found_at: dict[str, Any] | None
    generations: int
    evaluations: int
    seconds: float
    seconds_to_ready: float
    cpu_seconds: float
    nodes: int
    topology: str
    deme: int
    mode: str
    seed: int
    run: dict[str, Any]
    problem_sha256: str
    versions: dict[str, str]
    directives: list[dict[str, Any]]
    messages: dict[str, int]
    staleness: dict[str, float] | None
    history_sha256: str | None
    message: str | None = None
    target: float | None = None
    clearance: dict[str, Any] | None = None
    best_attempt: dict[str, Any] | None = None
    solved_when: str | None = None
    oracle: str | None = None
    advice: list[str] = field(default_factory=list)
    words: str | None = field(default=None, repr=False)
    demes: list[bytes] = field(default_factory=list, repr=False)

    @property
    def found(self) -> dict[str, Any] | None:
        """The solution, or the best attempt if there is no solution."""
        return self.best_attempt if self.solution is None else self.solution

    @property
    def path(self) -> NDArray[np.float64] | None:
        """The path of the solution, shape (points, numbers of a point); None if it has none."""
        return None if self.solution is None or "path" not in self.solution else np.array(self.solution["path"])

    @property
    def configuration(self) -> NDArray[np.float64] | None:
        """The configuration of the solution, shape (joints,); None if it has none."""
        found = None if self.solution is None else self.solution.get("configuration")
        return None if found is None else np.array(found)

    @property
    def trajectory(self) -> dict[str, NDArray[np.float64]] | None:
        """The trajectory of the solution, its columns such as ``t`` and ``q`` as arrays; None if it has none."""
        found = None if self.solution is None else self.solution.get("trajectory")
        return {name: np.array(column) for name, column in found.items()} if isinstance(found, dict) else None

    def to_json(self) -> dict[str, Any]:
        """Return the result as plain JSON values; a fitness of +inf becomes null. Words and demes are left out."""
        values = asdict(self)
        del values["demes"], values["words"]
        if not math.isfinite(self.fitness):
            values["fitness"] = None
        return values


@dataclass(frozen=True)
class Clocks:
    """How long a run took, in seconds; see `Result`."""

    seconds: float
    seconds_to_ready: float
    cpu_seconds: float


def stop_reasons(reports: Sequence[Report], mode: str) -> tuple[Reason, ...]:
    """Return why the cells stopped: the reasons of the proposals for the generation of the stop, each once.

    In async mode cells share no such generation, so all proposals count.
    """
    if not reports:
        return ()
    stop = stopped_after(reports)
    proposals = [each for report in reports for each in report.proposals]
    return tuple(dict.fromkeys(each.reason for each in proposals if mode == "async" or each.stop_at == stop))


def states_of(reports: Sequence[Report]) -> dict[int, bytes]:
    """Return the states that cells report of their problem objects, by cell; cells without one are left out."""
    return {report.cell: report.state for report in reports if report.state}


def result_of(
    job: str, first: Run, past: Past, epoch: Lived, judgement: Judgement, versions: dict[str, str], clocks: Clocks
) -> Result:
    """Return the result of a job, from the reports of its last epoch, its past, and the spy's judgement.

    Args:
        job: the job's name.
        first: the settings that the job began with.
        past: the epochs before the last one.
        epoch: the last epoch with the reports of its cells.
        judgement: the spy's judgement of the last epoch.
        versions: versions and processor of the nodes.
        clocks: how long the run took.
    """
    file, best, whole = epoch.file, judgement.best, past.and_then(epoch)
    run, found = file.run, None if best is None else best.solution
    topology = topologies.parse(run.topology)
    return Result(
        job=job,
        kind=file.kind,
        status=judgement.status,
        solved=judgement.status == "solved",
        feasible=judgement.feasible,
        fitness=math.inf if best is None else best.fitness,
        solution=found if judgement.feasible else None,
        found_at=None if best is None else _found_at(best, topology),
        generations=whole.generations,
        evaluations=whole.evaluations,
        seconds=round(clocks.seconds, 6),
        seconds_to_ready=round(clocks.seconds_to_ready, 6),
        cpu_seconds=round(clocks.cpu_seconds, 6),
        nodes=topology.cells,
        topology=topology.spec,
        deme=run.deme,
        mode=run.mode,
        seed=run.seed,
        run=first.model_dump(),
        problem_sha256=file.sha256,
        versions=versions,
        directives=[*whole.directives, *_deadly(epoch.reports), *_stops(epoch.reports)],
        messages=asdict(whole.messages),
        staleness=_staleness(whole.staleness) if run.mode == "async" else None,
        history_sha256=whole.history if judgement.status != "failed" else None,
        message=judgement.message,
        target=judgement.target,
        clearance=judgement.clearance,
        solved_when=judgement.solved_when,
        oracle=judgement.oracle,
        advice=list(judgement.advice),
        best_attempt=None if judgement.feasible else found,
        words=judgement.words,
        demes=[report.deme for report in sorted(epoch.reports, key=lambda report: report.cell)],
    )


def _staleness(staleness: Staleness) -> dict[str, float] | None:
    """Return the staleness over all cells as results have it; None if there were no immigrants at all."""
    immigrants = staleness.immigrants
    if immigrants == 0:
        return None
    return {
        "mean": round(staleness.behind / immigrants, 6),
        "max": staleness.furthest,
        "again": round(staleness.again / immigrants, 6),
    }


def _found_at(best: Improvement, topology: Topology) -> dict[str, Any]:
    """Return where an individual was born. Generations count from 0 in each epoch, and epoch 0 is left out."""
    place = {"cell": list(topology.place(best.cell)), "generation": best.generation}
    return place | ({"epoch": best.epoch} if best.epoch else {})


def _deadly(reports: Sequence[Report]) -> list[dict[str, Any]]:
    """Return the directives about genomes that counted as infeasible, one for each problem that the job has had."""
    genomes: dict[str, set[str]] = {}
    for problem, genome in itertools.chain.from_iterable(report.infeasible for report in reports):
        genomes.setdefault(problem, set()).add(genome.hex())
    return [
        {"do": "infeasible", "problem_sha256": problem, "genomes": sorted(found)}
        for problem, found in sorted(genomes.items())
    ]


def _stops(reports: Sequence[Report]) -> list[dict[str, Any]]:
    """Return the directives of the stops from outside that were proposed in the last epoch."""
    proposals = [each for report in reports for each in report.proposals if each.reason in _FROM_OUTSIDE]
    return [{"do": "stop", "generation": each.stop_at, "reason": each.reason} for each in proposals]
