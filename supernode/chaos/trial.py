"""Carry out faults on the processes of a cluster that is started for it, while it runs one job."""

import contextlib
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import topologies
from coordinator.errors import ClusterFailed
from coordinator.launch.compilation import compile_missing
from coordinator.launch.launcher import ServiceOptions
from problems import BadInput, ProblemFile
from spy.result import Result
from supernode.chaos.hosts import HostedCluster
from supernode.chaos.means import Means
from supernode.chaos.network import Network
from supernode.chaos.repeating import repeated
from supernode.chaos.schedule import Fault
from supernode.client.client import Client, ClientJob
from supernode.client.cluster_info import Place
from supernode.launch.supervisor import LaunchRequest, Supervisor
from supernode.reports.records import pages

_ENDS_WITHIN = 120.0  # seconds after the last fault
_RUNS_WITHIN = 60.0  # seconds
_LOOK_EVERY = 0.05  # seconds
_NEWS_WITHIN = 2.0  # seconds; news comes about once a second
_ANOTHER_EPOCH = "another epoch begins"  # how a line of the coordinator's log begins
_GOES_ON = re.compile(r"new processes go on where the dead ones were: cells (.*)")


@dataclass
class Outcome:
    """What a trial has shown.

    Attributes:
        done: the faults that were carried out, each with its Unix time.
        result: the job's result; None if the job did not end.
        whole_again: for each cell that died and went on exactly, the seconds from its death until then.
        best_told: the best fitness that the client was told in each epoch.
        broken: why the cluster did not answer any more; None if it did.
        worse_told: improvements that were worse than an earlier one of the same epoch.
        repeats: whether a replay of the result has the same history; None if it has no history, as in async mode.
        stood_still: the longest time without news of a new generation, in seconds. The news comes about once a second,
            and not while there is no spy. None if none came.
        bred_apart: for each time that a host was cut off for so long that news came meanwhile, the generations that
            the foremost cell bred after the first two seconds of it.
    """

    done: list[tuple[float, Fault]] = field(default_factory=list)
    result: Result | None = None
    whole_again: list[float] = field(default_factory=list)
    best_told: dict[int, float] = field(default_factory=dict)
    broken: str | None = None
    worse_told: int = 0
    repeats: bool | None = None
    stood_still: float | None = None
    bred_apart: list[int] = field(default_factory=list)

    @property
    def lost(self) -> list[str]:
        """Return what was lost, a sentence for each; empty if nothing was."""
        if self.broken is not None:
            return [f"the cluster broke: {self.broken}"]
        if self.result is None:
            return [f"the job did not end within {_ENDS_WITHIN:.0f} s after the last fault"]
        found = []
        if self.result.status == "failed":
            found.append(f"the job failed: {self.result.message}")
        if self.best_told and self.result.fitness > self.best_told[max(self.best_told)]:
            found.append("the result is worse than an answer that the client had been told")
        if self.worse_told:
            found.append(f"{self.worse_told} improvements were worse than earlier ones")
        if any(each["do"] == "restart" for each in self.result.directives):
            found.append("all demes were lost, and the job began anew")
        elif self.repeats is False:
            found.append("a replay of the result has another history")
        return found


def run(
    file: ProblemFile,
    faults: Sequence[Fault],
    force: bool,
    say: Callable[[str], None],
    disk: Path | None = None,
    network: Network | None = None,
) -> Outcome:
    """Start a cluster, run the problem on it under faults, and return what has happened.

    Args:
        file: the problem, with the settings of the run.
        faults: what to do, in the order of time.
        force: start it even if this machine cannot hold so many nodes.
        say: called with a line about each fault.
        disk: the disk for the cluster's state, which faults may fill; None: some folder, and no such fault.
        network: the hosts for the nodes, which faults may cut off; None: all are on this one, and no such fault.

    Raises:
        BadInput: if the problem is wrong, or this machine cannot hold so many nodes.
        ClusterFailed: if the cluster does not come up.
    """
    outcome = Outcome()
    with _up(file, force, disk, network) as means, Client(Place.at(means.endpoint)) as client:
        job = client.submit(file)
        ended = threading.Event()
        listener = threading.Thread(target=_listen, args=(job, outcome, ended), name="improvements", daemon=True)
        listener.start()
        try:
            _try(job, client, faults, means, ended, outcome, say)
        except ClusterFailed as error:
            outcome.broken = str(error)
        listener.join(_ENDS_WITHIN)
    if outcome.result is not None and file.run.mode == "lockstep":
        say(f"repeating the run in this process: {outcome.result.generations:,} generations")
        outcome.repeats = _repeats(file, outcome.result)
    return outcome


@contextlib.contextmanager
def _up(file: ProblemFile, force: bool, disk: Path | None, network: Network | None) -> Iterator[Means]:
    """Start a cluster, and yield how it can be reached."""
    module, own, _ = file.kind.partition(":")
    modules = (module,) if own else ()
    if network is None:
        service = ServiceOptions(state=disk, allow_modules=modules, modules=file.folder)
        with Supervisor(LaunchRequest(file.run.topology, service, force=force)).up() as up:
            yield Means(up.endpoint, up.processes, disk)
    else:
        compile_missing()
        nodes = topologies.parse(file.run.topology).cells
        with HostedCluster(network, nodes, disk, modules=modules, folder=file.folder, force=force) as cluster:
            yield Means(cluster.connect, cluster.processes, disk, network, cluster.nodes_on)


def _try(
    job: ClientJob,
    client: Client,
    faults: Sequence[Fault],
    means: Means,
    ended: threading.Event,
    outcome: Outcome,
    say: Callable[[str], None],
) -> None:
    """Carry out the faults once the job runs, end the job, and note how it went.

    Raises:
        ClusterFailed: if the cluster does not answer any more.
    """
    deaths: list[tuple[float, int]] = []
    if _wait_for(lambda: job.state() not in ("submitted", "queued", "preparing"), _RUNS_WITHIN):
        nodes = job.show()["nodes"]  # in the order of cells: hosts may have joined in another one
        cells = {node: cell for cell, node in enumerate(nodes)}
        deaths = [(at, cells[node]) for at, node in _carry_out(faults, means, ended, outcome, say) if node in cells]
    job.cancel()
    with contextlib.suppress(TimeoutError):
        outcome.result = job.result(_ENDS_WITHIN)
    outcome.whole_again = _whole_again(deaths, _records(client, "log", job.id))
    statistics = list(_records(client, "statistics", job.id))
    outcome.stood_still = _stood_still(statistics)
    outcome.bred_apart = _bred_apart(outcome.done, statistics)


def _carry_out(
    faults: Sequence[Fault],
    means: Means,
    ended: threading.Event,
    outcome: Outcome,
    say: Callable[[str], None],
) -> list[tuple[float, int]]:
    """Carry out the faults until the job has ended; return the nodes that died by them, each with the Unix time.

    The coordinator is not asked meanwhile: without one the next faults would have to wait.
    """
    deaths: list[tuple[float, int]] = []
    began, timers = time.monotonic(), list[threading.Timer]()
    with contextlib.ExitStack() as at_last:  # also if the cluster breaks, or somebody presses Ctrl-C
        for fault in faults:
            if ended.wait(max(0.0, began + fault.at - time.monotonic())):
                break
            dying, end = means.dying(fault), means.begin(fault)
            if end is None:
                continue
            at = time.time()
            outcome.done.append((at, fault))
            deaths += [(at, node) for node in dying]
            lasts = f" for {fault.seconds:.1f} s" if fault.seconds else ""
            say(f"{fault.at:6.1f} s  {fault.do} {fault.target}{lasts}")
            if fault.seconds:
                at_last.callback(end)
                timers.append(threading.Timer(fault.seconds, end))
                at_last.callback(timers[-1].cancel)
                timers[-1].start()
        for timer in timers:
            timer.join()
        at_last.pop_all()  # all have ended by themselves
    return deaths


def _listen(job: ClientJob, outcome: Outcome, ended: threading.Event) -> None:
    """Note what the client is told, and when the job has ended."""
    with contextlib.suppress(ClusterFailed):  # `_try` notes that too
        for better in job.improvements():
            best = outcome.best_told.get(better.epoch)
            outcome.worse_told += best is not None and better.fitness > best
            outcome.best_told[better.epoch] = better.fitness if best is None else min(best, better.fitness)
        ended.set()


def _wait_for(happened: Callable[[], bool], seconds: float) -> bool:
    until = time.monotonic() + seconds
    while not happened():
        if time.monotonic() > until:
            return False
        time.sleep(_LOOK_EVERY)
    return True


def _records(client: Client, kind: str, job: str) -> Iterator[dict[str, Any]]:
    for page in pages(client, kind, job):
        yield from (dict(zip(page.columns, row, strict=True)) for row in page.rows)


def _whole_again(deaths: Sequence[tuple[float, int]], records: Iterable[Mapping[str, Any]]) -> list[float]:
    """Return for each death of a cell that went on exactly the seconds until then.

    A cell that died twice before it went on counts once, from its first death. What another epoch has settled does not
    count.
    """
    found = []
    for record in sorted(records, key=lambda record: record["at"]):
        text, at = record["text"], record["at"]
        if text.startswith(_ANOTHER_EPOCH):
            deaths = [each for each in deaths if each[0] > at]
        elif (line := _GOES_ON.fullmatch(text)) is not None:
            for cell in map(int, line[1].split(", ")):
                earlier = [died for died, whose in deaths if whose == cell and died <= at]
                found += [at - min(earlier)] if earlier else []
                deaths = [each for each in deaths if each[1] != cell or each[0] > at]
    return sorted(found)


def _stood_still(records: Iterable[Mapping[str, Any]]) -> float | None:
    """Return the longest time from one record to the next one of a later epoch or generation, or to the last one."""
    longest, latest = None, None
    for record in sorted(records, key=lambda record: record["at"]):
        if latest is not None:
            longest = max(longest or 0.0, record["at"] - latest["at"])
        if latest is None or _progress(record) > _progress(latest):
            latest = record
    return longest


def _bred_apart(done: Iterable[tuple[float, Fault]], records: Sequence[Mapping[str, Any]]) -> list[int]:
    """Return for each cut the generations between the first news that is of the time within it and the last.

    A cut of which there is less than two pieces of news does not count.
    """
    found = []
    for at, fault in done:
        if fault.do == "part":
            within = [each for each in records if at + _NEWS_WITHIN <= each["at"] <= at + fault.seconds]
            last_epoch = max((each["epoch"] for each in within), default=0)
            generations = [each["generation"] for each in within if each["epoch"] == last_epoch]
            found += [max(generations) - min(generations)] if len(generations) > 1 else []
    return found


def _progress(record: Mapping[str, Any]) -> tuple[int, int]:
    return record["epoch"], record["generation"]


def _repeats(file: ProblemFile, result: Result) -> bool:
    """Return whether the run that a result tells of has the same history if it is lived through once more."""
    try:
        history = repeated(file, result.directives).history
    except BadInput:
        return False
    return result.history_sha256 is not None and history == result.history_sha256
