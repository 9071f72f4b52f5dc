"""Carry out faults on the processes of a cluster that is started for it, while it runs one job."""

import contextlib
import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from coordinator.errors import ClusterFailed
from coordinator.jobs.states import ENDS
from coordinator.launch.launcher import ServiceOptions
from problems import BadInput, ProblemFile
from spy.result import Result
from supernode.chaos.repeating import repeated
from supernode.chaos.schedule import Fault
from supernode.client.client import Client, ClientJob
from supernode.client.cluster_info import Place
from supernode.launch.supervisor import LaunchRequest, Supervisor
from supernode.reports.records import pages

_ENDS_WITHIN = 120.0  # seconds after the last fault
_RUNS_WITHIN = 60.0  # seconds
_LOOK_EVERY = 0.05  # seconds
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
    """

    done: list[tuple[float, Fault]] = field(default_factory=list)
    result: Result | None = None
    whole_again: list[float] = field(default_factory=list)
    best_told: dict[int, float] = field(default_factory=dict)
    broken: str | None = None
    worse_told: int = 0
    repeats: bool | None = None
    stood_still: float | None = None

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
    file: ProblemFile, faults: Sequence[Fault], force: bool, say: Callable[[str], None], disk: Path | None = None
) -> Outcome:
    """Start a cluster, run the problem on it under faults, and return what has happened.

    Args:
        file: the problem, with the settings of the run.
        faults: what to do, in the order of time.
        force: start it even if this machine cannot hold so many nodes.
        say: called with a line about each fault.
        disk: the disk for the cluster's state, which faults may fill; None: some folder, and no such fault.

    Raises:
        BadInput: if the problem is wrong, or this machine cannot hold so many nodes.
        ClusterFailed: if the cluster does not come up.
    """
    module, own, _ = file.kind.partition(":")
    service = ServiceOptions(state=disk, allow_modules=(module,) if own else (), modules=file.folder)
    request = LaunchRequest(file.run.topology, service, force=force)
    outcome = Outcome()
    with Supervisor(request).up() as up, Client(Place.at(up.endpoint)) as client:
        job = client.submit(file)
        listener = threading.Thread(target=_listen, args=(job, outcome), name="improvements", daemon=True)
        listener.start()
        try:
            begin = partial(_begin, processes=up.processes, disk=disk)
            _try(job, client, faults, begin, outcome, say)
        except ClusterFailed as error:
            outcome.broken = str(error)
        listener.join(_ENDS_WITHIN)
    if outcome.result is not None and file.run.mode == "lockstep":
        say(f"repeating the run in this process: {outcome.result.generations:,} generations")
        outcome.repeats = _repeats(file, outcome.result)
    return outcome


def _try(
    job: ClientJob,
    client: Client,
    faults: Sequence[Fault],
    begin: Callable[[Fault], Callable[[], None] | None],
    outcome: Outcome,
    say: Callable[[str], None],
) -> None:
    """Carry out the faults once the job runs, end the job, and note how it went.

    Raises:
        ClusterFailed: if the cluster does not answer any more.
    """
    if _wait_for(lambda: job.state() not in ("submitted", "queued", "preparing"), _RUNS_WITHIN):
        _carry_out(faults, begin, job, outcome, say)
    job.cancel()
    with contextlib.suppress(TimeoutError):
        outcome.result = job.result(_ENDS_WITHIN)
    outcome.whole_again = _whole_again(outcome.done, _records(client, "log", job.id))
    outcome.stood_still = _stood_still(_records(client, "statistics", job.id))


def _carry_out(
    faults: Sequence[Fault],
    begin: Callable[[Fault], Callable[[], None] | None],
    job: ClientJob,
    outcome: Outcome,
    say: Callable[[str], None],
) -> None:
    """Carry out the faults until the job has ended."""
    began, timers = time.monotonic(), list[threading.Timer]()
    with contextlib.ExitStack() as at_last:  # also if the cluster breaks, or somebody presses Ctrl-C
        for fault in faults:
            time.sleep(max(0.0, began + fault.at - time.monotonic()))
            if job.state() in ENDS:
                break
            end = begin(fault)
            if end is None:
                continue
            outcome.done.append((time.time(), fault))
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


def _begin(fault: Fault, processes: Callable[[], Mapping[str, int]], disk: Path | None) -> Callable[[], None] | None:
    """Carry out a fault; return what ends it, or None if there is no such process any more."""
    if fault.do == "fill":
        assert disk is not None
        return _fill(disk)
    process = processes().get(fault.target)
    if process is None:
        return None
    try:
        os.kill(process, signal.SIGKILL if fault.do == "kill" else signal.SIGSTOP)
    except ProcessLookupError:
        return None
    return partial(_let_go_on, process)


def _fill(disk: Path) -> Callable[[], None]:
    """Leave no room on a disk; return what makes room again."""
    filler, block = disk / "filler", bytes(1 << 16)
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as file:
        while True:
            file.write(block)
    return partial(filler.unlink, missing_ok=True)


def _let_go_on(process: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(process, signal.SIGCONT)


def _listen(job: ClientJob, outcome: Outcome) -> None:
    with contextlib.suppress(ClusterFailed):  # `_try` notes that too
        for better in job.improvements():
            best = outcome.best_told.get(better.epoch)
            outcome.worse_told += best is not None and better.fitness > best
            outcome.best_told[better.epoch] = better.fitness if best is None else min(best, better.fitness)


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


def _whole_again(done: Sequence[tuple[float, Fault]], records: Iterable[Mapping[str, Any]]) -> list[float]:
    """Return for each death of a cell that went on exactly the seconds until then.

    A cell that died twice before it went on counts once, from its first death. What another epoch has settled does not
    count.
    """
    deaths = [(at, fault.target.removeprefix("node ")) for at, fault in done if fault.do == "kill"]
    found = []
    for record in sorted(records, key=lambda record: record["at"]):
        text, at = record["text"], record["at"]
        if text.startswith(_ANOTHER_EPOCH):
            deaths = [each for each in deaths if each[0] > at]
        elif (line := _GOES_ON.fullmatch(text)) is not None:
            for cell in line[1].split(", "):
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


def _progress(record: Mapping[str, Any]) -> tuple[int, int]:
    return record["epoch"], record["generation"]


def _repeats(file: ProblemFile, result: Result) -> bool:
    """Return whether the run that a result tells of has the same history if it is lived through once more."""
    try:
        history = repeated(file, result.directives).history
    except BadInput:
        return False
    return result.history_sha256 is not None and history == result.history_sha256
