"""One job: conducted on the cluster by the coordinator's thread, followed by whoever submitted it."""

import dataclasses
import json
import queue
import threading
import time
from collections.abc import Callable, Iterator

import zenoh

import topologies
from coordinator.errors import ClusterFailed
from node.cell import ROOT
from problems import BadInput, ProblemFile
from spy.judge import Judgement
from spy.result import Clocks, Result, best_known, result_of, stop_reasons, stopped_after
from wire import control
from wire.callbacks import direct
from wire.control import Begin, Command, Done, Drop, Finish, Prepare, ProposeStop, Refused
from wire.keys import Keys
from wire.news import Improvement, Statistics
from wire.report import Reason, Report
from wire.strict import Rejected

_ANSWER_WITHIN = 60.0  # seconds; a problem may have much to prepare
_FOR_EVER = 30 * 24 * 3600.0  # seconds; a run may take long


@dataclasses.dataclass(frozen=True)
class _Failure:
    message: str


@dataclasses.dataclass(frozen=True)
class _Wish:
    """Somebody wants the job to stop."""

    reason: Reason


class Job:
    """A job of a `LocalCluster`."""

    def __init__(self, number: int, file: ProblemFile, log: str | None) -> None:
        self.number = number
        self.file = file
        self._log = log
        self._submitted = time.monotonic()
        self._mail: queue.SimpleQueue[Report | _Failure | _Wish] = queue.SimpleQueue()
        self._news: queue.SimpleQueue[Improvement | Statistics | None] = queue.SimpleQueue()
        self._best: Improvement | None = None
        self._ended = threading.Event()
        self._result: Result | None = None
        self._error: Exception | None = None
        self._failure: str | None = None

    # For those who submitted it ---------------------------------------------------------------------------------------
    def improvements(self) -> Iterator[Improvement]:
        """Each verified improvement as it comes; ends with the job.

        Raises:
            BadInput: if the problem turns out to be wrong where its module is imported.
        """
        for event in self.events():
            if isinstance(event, Improvement):
                yield event

    def events(self) -> Iterator[Improvement | Statistics]:
        """Improvements, and statistics of the whole cluster twice a second; ends with the job."""
        while (event := self._news.get()) is not None:
            yield event
        self._news.put(None)  # for whoever asks again
        if self._error is not None:
            raise self._error

    def result(self, timeout: float | None = None) -> Result:
        """Wait for the end.

        Args:
            timeout: seconds.

        Raises:
            TimeoutError: if the job has not ended by then.
            BadInput: if the problem turns out to be wrong where its module is imported.
        """
        if not self._ended.wait(timeout):
            raise TimeoutError(f"job {self.number} has not ended within {timeout} s")
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    def cancel(self) -> None:
        """Ask all cells to stop; the result is the best so far, with status "cancelled"."""
        self._mail.put(_Wish("cancel"))

    # For the coordinator ----------------------------------------------------------------------------------------------
    def fail(self, message: str) -> None:
        """End the job because the cluster failed."""
        self._failure = message
        self._mail.put(_Failure(message))

    def conduct(
        self, session: zenoh.Session, keys: Keys, seconds_to_ready: float, cpu_seconds: Callable[[], float]
    ) -> None:
        """Run the job to its end, on the coordinator's thread."""
        conductor = _Conductor(self, session, keys)
        used = cpu_seconds()
        reports: list[Report] = []
        try:
            judgement = conductor.run(reports)
        except BadInput as error:
            self._end(None, error)
            return
        except ClusterFailed as error:
            conductor.drop()
            judgement = Judgement("failed", False, self._failure or str(error), self._best)
        finally:
            conductor.close()
        clocks = Clocks(conductor.seconds, seconds_to_ready, cpu_seconds() - used)
        reports.sort(key=lambda report: report.cell)
        self._end(result_of(str(self.number), self.file, reports, judgement, conductor.versions, clocks), None)

    def _improve(self, better: Improvement | None) -> None:
        if better is not None and (self._best is None or better.fitness < self._best.fitness):
            self._best = better
            self._news.put(better)

    def _end(self, result: Result | None, error: Exception | None) -> None:
        self._result, self._error = result, error
        self._ended.set()
        self._news.put(None)


class _Conductor:
    """The coordinator's part in one job: prepare all, start all, pass wishes on, gather the reports."""

    def __init__(self, job: Job, session: zenoh.Session, keys: Keys) -> None:
        self.job = job
        self.session = session
        self.keys = keys
        self.cells = topologies.parse(job.file.run.topology).cells
        self.seconds = 0.0
        self.versions: dict[str, str] = {}
        self._subscribers = [
            session.declare_subscriber(keys.best, direct(self._hear_best)),
            session.declare_subscriber(keys.spy_stats, direct(self._hear_statistics)),
        ]

    def close(self) -> None:
        for subscriber in self._subscribers:
            subscriber.undeclare()  # type: ignore[no-untyped-call]

    def run(self, reports: list[Report]) -> Judgement:
        """Fill ``reports`` and return what the spy makes of them.

        Raises:
            BadInput: if the problem is wrong.
            ClusterFailed: if a process died.
        """
        job = self.job
        self._prepare()
        self._ask(self.keys.spy_control, Begin(job.number))
        began = time.monotonic()
        self.session.get(
            self.keys.every_control,
            direct(self._hear_report),
            payload=control.encode(Begin(job.number)),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_FOR_EVER,
        )
        error = self._gather(reports)
        self.seconds = time.monotonic() - began
        if error is not None:
            self.drop()
        return self._finish(reports, error)

    def drop(self) -> None:
        """Let the nodes forget a job that failed, if they still can hear."""
        self._tell(self.keys.every_control, Drop(self.job.number))

    def _prepare(self) -> None:
        """The spy first: it finds a wrong problem before a thousand nodes do."""
        job = self.job
        self._ask(self.keys.spy_control, Prepare(job.number, job.file.to_json(), job._log))
        answers = self._ask(self.keys.every_control, Prepare(job.number, job.file.to_json()), self.cells)
        fingerprints = {answer.note for answer in answers}
        if job.file.run.mode == "lockstep" and len(fingerprints) > 1:
            raise ClusterFailed(f"nodes differ, lockstep would not repeat: {' / '.join(sorted(fingerprints))}")
        self.versions = json.loads(answers[0].note)

    def _ask(self, key: str, command: Command, expected: int = 1) -> list[Done]:
        """The answers of all that ``key`` reaches.

        Raises:
            BadInput: as the first refusal says.
            ClusterFailed: as the first refusal says, or because fewer answered than expected.
        """
        answers = []
        for reply in self.session.get(
            key,
            payload=control.encode(command),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_ANSWER_WITHIN,
        ):
            if reply.ok is not None:
                answers.append(control.decode_answer(reply.ok.payload.to_bytes()))
        for answer in answers:
            if isinstance(answer, Refused):
                raise BadInput(answer.message) if answer.blame == "input" else ClusterFailed(answer.message)
        done = [answer for answer in answers if isinstance(answer, Done)]
        if len(done) < expected:
            raise ClusterFailed(f"{len(done)} of {expected} answered to {command.name!r} within {_ANSWER_WITHIN:.0f} s")
        return done

    def _gather(self, reports: list[Report]) -> str | None:
        """Wait for the report of every cell, passing on wishes to stop and the deadline.

        Returns why a cell failed, if one did; the others are not waited for then.
        """
        run = self.job.file.run
        deadline = None if run.seconds is None else self.job._submitted + run.seconds
        while len(reports) < self.cells:
            try:
                left = None if deadline is None else max(0.0, deadline - time.monotonic())
                mail = self.job._mail.get(timeout=left)
            except queue.Empty:
                mail, deadline = _Wish("deadline"), None
            if isinstance(mail, _Failure):
                raise ClusterFailed(mail.message)
            if isinstance(mail, _Wish):
                self._tell(self.keys.control(ROOT), ProposeStop(self.job.number, mail.reason))
                continue
            reports.append(mail)
            if mail.error is not None:
                return mail.error
            if run.mode == "async" and len(reports) == 1 and mail.proposals:
                # Without lockstep a lost message could leave a node that never hears of the stop.
                self._tell(self.keys.every_control, ProposeStop(self.job.number, mail.proposals[0].reason))
        return None

    def _tell(self, key: str, command: Command) -> None:
        """Send a command without waiting for the answers."""
        self.session.get(
            key,
            direct(lambda _: None),
            payload=control.encode(command),
            target=zenoh.QueryTarget.ALL,
            timeout=_ANSWER_WITHIN,
        )

    def _finish(self, reports: list[Report], error: str | None) -> Judgement:
        run = self.job.file.run
        champion = best_known(reports, run.spy)
        reasons = stop_reasons(reports, run.mode)
        command = Finish(self.job.number, champion, stopped_after(reports), reasons, error)
        answer = json.loads(self._ask(self.keys.spy_control, command)[0].note)
        best = None if answer["best"] is None else Improvement.decode(bytes.fromhex(answer["best"]))
        self.job._improve(best)
        return Judgement(answer["status"], answer["feasible"], answer["message"], best)

    # Called by Zenoh, on its thread -----------------------------------------------------------------------------------
    def _hear_report(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            return
        try:
            self.job._mail.put(Report.decode(reply.ok.payload.to_bytes()))
        except Rejected as error:
            self.job.fail(f"a node's report is not readable: {error.reason}")

    def _hear_best(self, sample: zenoh.Sample) -> None:
        better = Improvement.decode(sample.payload.to_bytes())
        if better.job == self.job.number:
            self.job._improve(better)

    def _hear_statistics(self, sample: zenoh.Sample) -> None:
        statistics = Statistics.decode(sample.payload.to_bytes())
        if statistics.job == self.job.number:
            self.job._news.put(statistics)
