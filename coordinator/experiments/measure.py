"""Make single runs of an experiment and measure what they and their processes use."""

import contextlib
import math
import statistics
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from coordinator.experiments.experiment import Case
from coordinator.experiments.journal import Record
from coordinator.launch.cluster import LocalCluster
from node.fingerprint import fingerprint
from node.plan import Plan
from node.simulation import StopRequest, simulate
from problems import ProblemFile
from spy.collector import Collector
from spy.improvement_records import ImprovementRecord, records_of
from spy.past import Lived, Past, best_known, stopped_after
from spy.result import Clocks, Result, result_of, states_of, stop_reasons
from spy.verification import verify
from wire.champion import Champion
from wire.news import Improvement

_CPU_IN_ONE_PROCESS = ("cpu_seconds", "node_cpu_seconds", "critical_cpu_seconds")
_LEAST_CPU = 1e-6  # seconds; keeps quotients of CPU times finite


def memory_of_nodes(cluster: LocalCluster) -> float:
    """Return the mean memory of a node in bytes, shared pages divided among their users (PSS). Takes 1 ms a node."""
    sizes = [_pss(process) for name, process in cluster.processes.items() if _is_node(name)]
    return sum(sizes) / len(sizes)


def run_on_nodes(
    cluster: LocalCluster, file: ProblemFile, case: Case, preparation: dict[str, float]
) -> tuple[Record, dict[str, float]]:
    """Make one run on a cluster.

    Args:
        cluster: the cluster.
        file: the problem with the settings of the run.
        case: the run.
        preparation: by process, the CPU seconds that preparing a job costs; they are subtracted.

    Returns:
        The record of the run, and the CPU seconds that each process used for it.
    """
    before = cluster.cpu_seconds_by_process()
    job = cluster.submit(file)
    told = list(job.improvements())
    result = job.result()
    after = cluster.cpu_seconds_by_process()
    used = {name: after[name] - before[name] - preparation.get(name, 0.0) for name in before.keys() & after.keys()}
    nodes = [max(each, _LEAST_CPU) for name, each in used.items() if _is_node(name)] or [math.nan]
    cpu = {
        "cpu_seconds": result.cpu_seconds,
        "node_cpu_seconds": sum(nodes),
        "critical_cpu_seconds": max(nodes),
        "median_node_cpu_seconds": statistics.median(nodes),
        "spy_cpu_seconds": used.get("spy"),
        "router_cpu_seconds": used.get("router"),
    }
    return _record(case, result, _hit(told, result.target), job.history(), cpu), used


def run_in_process(file: ProblemFile, case: Case) -> Record:
    """Make one run by the simulator, in this process and without messages; return its record.

    Its CPU time is that of this process.

    Raises:
        EvaluationFailed: if the problem's evaluation fails.
    """
    plan = Plan.of(file)
    collector = Collector(plan, job=1)
    began, used = time.monotonic(), time.process_time()

    told: list[Improvement] = []

    def hear(champion: Champion | None) -> None:
        better = collector.hear(champion, time.monotonic() - began)
        if better is not None:
            told.append(better)

    reports = simulate(plan, watch=lambda _, champion: hear(champion), outside=StopRequest(file.run.seconds).reason)
    cpu = max(time.process_time() - used, _LEAST_CPU)
    seconds = time.monotonic() - began
    hear(best_known(reports, file.run.spy))
    reasons = stop_reasons(reports, file.run.mode)
    judgement = verify(collector, stopped_after(reports), reasons, states=states_of(reports))
    clocks = Clocks(seconds, 0.0, cpu)
    result = result_of("1", file.run, Past(), Lived(file, reports), judgement, fingerprint(), clocks)
    records = records_of(Past(), Lived(file, reports))
    return _record(case, result, _hit(told, result.target), records, dict.fromkeys(_CPU_IN_ONE_PROCESS, cpu))


def _hit(told: Sequence[Improvement], target: float | None) -> Improvement | None:
    """Return the first published improvement that reached the target; unlike cells' own records these have a time."""
    return next((better for better in told if target is not None and better.fitness <= target), None)


def _record(
    case: Case,
    result: Result,
    hit: Improvement | None,
    records: Sequence[ImprovementRecord],
    cpu: dict[str, float | None],
) -> Record:
    """Return the record of a run; it is flat, since it becomes a row of a table."""
    staleness = result.staleness or {}
    return {
        "type": "run",
        "key": case.key,
        "role": case.role,
        "nodes": case.nodes,
        "topology": result.topology,
        "mode": case.mode,
        "deme": case.deme,
        "population": case.nodes * case.deme,
        "goal": case.goal,
        "seed": case.seed,
        "status": result.status,
        "solved": result.solved,
        "feasible": result.feasible,
        "fitness": result.fitness if math.isfinite(result.fitness) else None,
        "generations": result.generations,
        "evaluations": result.evaluations,
        "evaluations_to_target": _evaluations_to_target(result, records),
        "seconds": result.seconds,
        "seconds_to_target": hit.seconds if result.solved and hit is not None else None,
        **{name: None if value is None or math.isnan(value) else round(value, 9) for name, value in cpu.items()},
        **{f"messages_{name}": result.messages[name] for name in ("sent", "received", "lost", "rejected")},
        "staleness_mean": staleness.get("mean"),
        "staleness_max": staleness.get("max"),
        "history_sha256": result.history_sha256,
        "message": result.message,
        "ended": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def _evaluations_to_target(result: Result, records: Sequence[ImprovementRecord]) -> int | None:
    """Return the evaluations of all nodes up to the end of the generation that first reached the target.

    They are taken from what the cells noted, not from what the spy received, so in lockstep they are equal for equal
    runs. In async mode some cells may not have come to that generation; the result never exceeds all evaluations made.
    """
    if not result.solved or result.target is None:
        return None
    reached = (record.evaluations for record in records if record.fitness <= result.target)
    return min(result.evaluations, next(reached, result.evaluations))


def _is_node(name: str) -> bool:
    return name.startswith("node ")


def _pss(process: int) -> float:
    with contextlib.suppress(OSError):  # the process has ended
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return float(line.split()[1]) * 1024
    return 0.0
