"""The result of a run, as `--json` prints it and Python users get it."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import topologies
from problems import Run
from spy.past import Lived, Past, stopped_after
from spy.verification import Judgement, Status
from topologies import Topology
from wire.news import Improvement
from wire.report import Reason, Report, Staleness

_FROM_OUTSIDE: tuple[Reason, ...] = ("deadline", "cancel", "infeasible")


@dataclass(frozen=True)
class Result:
    """What came of a job.

    Attributes:
        status: "solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled" or "failed".
        solved: whether the target was reached.
        feasible: whether the planner's independent check accepts what was found.
        fitness: of the solution, or without one of the best attempt; +inf if there is neither.
        solution: the planner's own plain values; None unless the check accepts them.
        found_at: cell and generation of the birth of the solution, or of the best attempt.
        generations: after which all cells stopped; in async mode the median over cells.
        evaluations: all fitness calls in nodes.
        seconds: from the start to the last stop.
        seconds_to_ready: from the call to the ready cluster.
        cpu_seconds: of all processes.
        run: the settings of the first epoch; `directives` say what came after it. All else is of the last one.
        directives: what came from outside, and after which generation.
        staleness: in async mode, how many generations the immigrants bred with were behind their cells (mean, max), and
            the share of them that had been bred with before (again); None in lockstep, where all are of one generation.
        history_sha256: equal for equal lockstep runs; None if the run failed, or not all of it is known.
        message: why it failed, or what the check has against the solution.
        target: the fitness that counts as solved, if there is one.
        clearance: how close the solution, or the best attempt, comes to what it must not touch: the ``"least"``
            distance (None if there is nothing to come close to), ``"where"`` that is, what was ``"required"``, and the
            ``"unit"`` of both; None if this kind has none.
        best_attempt: the best that was found, in the shape of a solution, if the check does not accept it; else None.
        solved_when: what the target means, in words, or why there is none.
        oracle: what an exact method says, in words: that there is no way, or that this is the optimum, or which one is;
            None if there is none, or it did not come to an answer.
        advice: what to turn, if the run has stalled, a line each.
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
    words: str | None = field(default=None, repr=False)  # the solution in words
    demes: list[bytes] = field(default_factory=list, repr=False)  # the last individuals of each cell, for pictures

    @property
    def found(self) -> dict[str, Any] | None:
        """The solution, or without one the best attempt."""
        return self.best_attempt if self.solution is None else self.solution

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values; +inf becomes null."""
        values = asdict(self)
        del values["demes"], values["words"]
        if not math.isfinite(self.fitness):
            values["fitness"] = None
        return values


@dataclass(frozen=True)
class Clocks:
    """Seconds that a run took, see `Result`."""

    seconds: float
    seconds_to_ready: float
    cpu_seconds: float


def stop_reasons(reports: Sequence[Report], mode: str) -> tuple[Reason, ...]:
    """Why the cells stopped: the reasons proposed for the generation of the stop (in async mode, all)."""
    if not reports:
        return ()
    stop = stopped_after(reports)
    proposals = [each for report in reports for each in report.proposals]
    return tuple(dict.fromkeys(each.reason for each in proposals if mode == "async" or each.stop_at == stop))


def states_of(reports: Sequence[Report]) -> dict[int, bytes]:
    """What the cells have to say of their problems' states, where they have something to say."""
    return {report.cell: report.state for report in reports if report.state}


def result_of(
    job: str, first: Run, past: Past, epoch: Lived, judgement: Judgement, versions: dict[str, str], clocks: Clocks
) -> Result:
    """Put together what the cells of the last ``epoch`` report, what came before it, and what the spy verifies.

    ``first`` are the settings that the job began with.
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
        directives=[*whole.directives, *_stops(epoch.reports)],
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
    """Over all cells; None if there were no immigrants at all."""
    immigrants = staleness.immigrants
    if immigrants == 0:
        return None
    return {
        "mean": round(staleness.behind / immigrants, 6),
        "max": staleness.furthest,
        "again": round(staleness.again / immigrants, 6),
    }


def _found_at(best: Improvement, topology: Topology) -> dict[str, Any]:
    """Generations count from 0 in each epoch; the first epoch goes without saying."""
    place = {"cell": list(topology.place(best.cell)), "generation": best.generation}
    return place | ({"epoch": best.epoch} if best.epoch else {})


def _stops(reports: Sequence[Report]) -> list[dict[str, Any]]:
    """Who stopped the last epoch from outside, and when."""
    proposals = [each for report in reports for each in report.proposals if each.reason in _FROM_OUTSIDE]
    return [{"do": "stop", "generation": each.stop_at, "reason": each.reason} for each in proposals]
