"""The result of a run, as `--json` prints it and Python users get it."""

import hashlib
import itertools
import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import topologies
from problems import ProblemFile
from spy.judge import Judgement, Status
from topologies import ROOT, Topology
from wire.exchange import Champion
from wire.news import Improvement
from wire.report import Proposal, Reason, Report


@dataclass(frozen=True)
class Result:
    """What came of a job.

    Attributes:
        status: "solved", "stalled", "exhausted", "deadline", "cancelled" or "failed".
        solved: whether the target was reached.
        feasible: whether the planner's independent check accepts the solution.
        fitness: of the solution; +inf if nothing feasible was found.
        solution: the planner's own plain values, or None.
        found_at: cell and generation of the solution's birth.
        generations: after which all cells stopped; in async mode the median over cells.
        evaluations: all fitness calls in nodes.
        seconds: from the start to the last stop.
        seconds_to_ready: from the call to the ready cluster.
        cpu_seconds: of all processes.
        run: the settings of the first world; `directives` say what came after it. All else is of the last one.
        directives: what came from outside, and after which generation.
        staleness: in async mode, how many generations the immigrants bred with were behind their cells (mean, max), and
            the share of them that had been bred with before (again); None in lockstep, where all are of one generation.
        history_sha256: equal for equal lockstep runs; None if the run failed.
        message: why it failed, or what the check has against the solution.
        target: the fitness that counts as solved, if there is one.
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
    words: str | None = field(default=None, repr=False)  # the solution in words
    demes: list[bytes] = field(default_factory=list, repr=False)  # the last individuals of each cell, for pictures

    def to_json(self) -> dict[str, Any]:
        """Plain JSON values; +inf becomes null."""
        values = asdict(self)
        del values["demes"], values["words"]
        if not math.isfinite(self.fitness):
            values["fitness"] = None
        return values


@dataclass(frozen=True)
class Lived:
    """What became of a job in one of its worlds.

    Attributes:
        number: of the world.
        reports: of the cells that told of their end in it.
        why: how it followed the world before, as a directive.
    """

    file: ProblemFile
    reports: Sequence[Report] = ()
    why: Mapping[str, Any] = field(default_factory=dict)
    number: int = 0


@dataclass(frozen=True)
class Clocks:
    """Seconds that a run took, see `Result`."""

    seconds: float
    seconds_to_ready: float
    cpu_seconds: float


def best_known(reports: Sequence[Report], spy: str) -> Champion | None:
    """The best champion that the cells know at the end; under the paper's spy only what the root knows counts."""
    known = [report.champion for report in reports if spy == "champion" or report.cell == ROOT]
    return min((champion for champion in known if champion is not None), default=None)


def stopped_after(reports: Sequence[Report]) -> int:
    """The generation after which the cells stopped; in async mode the (lower) median."""
    return statistics.median_low(report.generation for report in reports)


def lived_for(reports: Sequence[Report], halted: bool) -> int:
    """Generations of a world. Where cells halted since one had died, the next world counts from the furthest."""
    return max(report.generation for report in reports) if halted else stopped_after(reports)


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
    job: str, worlds: Sequence[Lived], judgement: Judgement, versions: dict[str, str], clocks: Clocks
) -> Result:
    """Put together what the cells report of all worlds that the job lived in and what the spy judges of the last."""
    file, best = worlds[-1].file, judgement.best
    run = file.run
    topology = topologies.parse(run.topology)
    reports = [report for world in worlds for report in world.reports]
    last = sorted(worlds[-1].reports, key=lambda report: report.cell)
    return Result(
        job=job,
        kind=file.kind,
        status=judgement.status,
        solved=judgement.status == "solved",
        feasible=judgement.feasible,
        fitness=math.inf if best is None else best.fitness,
        solution=None if best is None else best.solution,
        found_at=None if best is None else _found_at(best, topology),
        generations=sum(_generations(worlds)),
        evaluations=sum(report.evaluations for report in reports),
        seconds=round(clocks.seconds, 6),
        seconds_to_ready=round(clocks.seconds_to_ready, 6),
        cpu_seconds=round(clocks.cpu_seconds, 6),
        nodes=topology.cells,
        topology=topology.spec,
        deme=run.deme,
        mode=run.mode,
        seed=run.seed,
        run=worlds[0].file.run.model_dump(),
        problem_sha256=file.sha256,
        versions=versions,
        directives=_directives(worlds),
        messages={
            name: sum(getattr(report, name) for report in reports) for name in ("sent", "received", "lost", "rejected")
        },
        staleness=_staleness(reports) if run.mode == "async" else None,
        history_sha256=_history(worlds) if judgement.status != "failed" else None,
        message=judgement.message,
        target=judgement.target,
        words=judgement.words,
        demes=[report.deme for report in last],
    )


def _generations(worlds: Sequence[Lived]) -> list[int]:
    """Of each world, as far as anybody has told."""
    halted = [after.why.get("do") == "replace" for after in worlds[1:]] + [False]
    return [lived_for(each.reports, dead) if each.reports else 0 for each, dead in zip(worlds, halted, strict=True)]


def _staleness(reports: Sequence[Report]) -> dict[str, float] | None:
    """Over all cells; None if there were no immigrants at all."""
    immigrants = sum(report.staleness.immigrants for report in reports)
    if immigrants == 0:
        return None
    return {
        "mean": round(sum(report.staleness.behind for report in reports) / immigrants, 6),
        "max": max(report.staleness.furthest for report in reports),
        "again": round(sum(report.staleness.again for report in reports) / immigrants, 6),
    }


def _history(worlds: Sequence[Lived]) -> str | None:
    """Over the digests of all cells, world by world; None if nobody knows of the first ones any more."""
    if worlds[0].number > 0:
        return None
    # What a node that died had lived through nobody knows: such a world is not counted.
    whole = [
        each for each, after in itertools.zip_longest(worlds, worlds[1:]) if not after or after.why["do"] != "replace"
    ]
    ordered = [sorted(world.reports, key=lambda report: report.cell) for world in whole]
    return hashlib.sha256(b"".join(report.digest for reports in ordered for report in reports)).hexdigest()


def _found_at(best: Improvement, topology: Topology) -> dict[str, Any]:
    """Generations count from 0 in each world; the first world goes without saying."""
    place = {"cell": list(topology.place(best.cell)), "generation": best.generation}
    return place | ({"world": best.world} if best.world else {})


def _directives(worlds: Sequence[Lived]) -> list[dict[str, Any]]:
    """What came from outside and when: how each world followed the one before, and who stopped the last one."""
    directives: list[dict[str, Any]] = []
    for generations, world in zip(_generations(worlds), worlds[1:], strict=False):
        directives.append({"world": world.number, "generation": generations, **world.why})
    for report in worlds[-1].reports:
        directives += [_directive(each) for each in report.proposals if each.reason in ("deadline", "cancel")]
    return directives


def _directive(proposal: Proposal) -> dict[str, Any]:
    return {"do": "stop", "generation": proposal.stop_at, "reason": proposal.reason}
