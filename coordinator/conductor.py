"""The coordinator's part in one job: prepare all, start all, pass wishes on, gather the reports, have them judged.

It waits in one place only, its mail: for answers, reports, wishes to stop, and the news that a process has died.
"""

import contextlib
import itertools
import json
import queue
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import zenoh

import topologies
from coordinator.errors import ClusterFailed
from coordinator.job import Failure, JobEntry, Wish
from problems import BadInput
from spy.judge import STATUS_OF, Judgement
from spy.result import Clocks, Result, best_known, result_of, states_of, stop_reasons, stopped_after
from topologies import ROOT
from wire import control
from wire.callbacks import direct
from wire.control import Begin, Command, Done, Drop, Finish, Judged, Prepare, ProposeStop, Refused
from wire.keys import Keys
from wire.news import Improvement, Statistics
from wire.report import Report
from wire.strict import Rejected

_ANSWER_WITHIN = 600.0  # seconds; a problem may have much to prepare, and a dead process is heard of otherwise
_FOR_EVER = 30 * 24 * 3600.0  # seconds; a run may take long
_DEATH_NOTICE = 1.0  # seconds: an answer that never comes may be explained this much later


@dataclass(frozen=True)
class _Answer:
    """To question number ``question``; None when there will be no more."""

    question: int
    answer: Done | Judged | Refused | None


class _GivenUpError(Exception):
    """Somebody wants the job to stop while nobody breeds yet, or no longer."""

    def __init__(self, wish: Wish) -> None:
        super().__init__(wish.reason)
        self.status = STATUS_OF[wish.reason]


class Conductor:
    """Conducts one job; `conduct` is all there is to call."""

    def __init__(self, job: JobEntry, session: zenoh.Session, keys: Keys) -> None:
        self.job = job
        self.number = job.order.number
        self.file = job.order.file
        self.session = session
        self.keys = keys
        self.cells = topologies.parse(self.file.run.topology).cells
        self.reports: list[Report] = []
        self.versions: dict[str, str] = {}
        self.best: Improvement | None = None
        self.seconds = 0.0
        self._cancelled = False
        self._questions = itertools.count()

    def conduct(self, seconds_to_ready: float, cpu_seconds: Callable[[], dict[str, float]]) -> Result:
        """Run the job to its end.

        Raises:
            BadInput: if the problem is wrong.
        """
        used = cpu_seconds()
        with self._listening():
            judgement = self._judgement()
        if judgement.best is not None:
            self._improve(judgement.best)
        spent = sum(after - used[name] for name, after in cpu_seconds().items() if name in used)
        clocks = Clocks(self.seconds, seconds_to_ready, spent)
        reports = sorted(self.reports, key=lambda report: report.cell)
        return result_of(str(self.number), self.file, reports, judgement, self.versions, clocks)

    @contextlib.contextmanager
    def _listening(self) -> Iterator[None]:
        subscribers = [
            self.session.declare_subscriber(self.keys.best, direct(self._hear_best)),
            self.session.declare_subscriber(self.keys.spy_stats, direct(self._hear_statistics)),
        ]
        try:
            yield
        finally:
            for subscriber in subscribers:
                with contextlib.suppress(zenoh.ZError):
                    subscriber.undeclare()  # type: ignore[no-untyped-call]

    def _judgement(self) -> Judgement:
        """What came of it, whatever goes wrong."""
        try:
            return self._run()
        except BadInput:
            self._drop()
            raise
        except _GivenUpError as error:
            self._drop()
            return Judgement(error.status, False, "stopped before there was a result", self.best)
        except ClusterFailed as error:
            self._drop()
            return Judgement("cancelled" if self._cancelled else "failed", False, str(error), self.best)
        except Exception as error:  # whatever it is, whoever waits for this job must hear of its end
            self._drop()
            return Judgement("failed", False, f"{type(error).__name__}: {error}", self.best)

    def _run(self) -> Judgement:
        self._prepare()
        self._ask(self.keys.spy_control, Begin(self.number))
        began = time.monotonic()
        try:
            self._get(self.keys.every_control, Begin(self.number), direct(self._hear_report), _FOR_EVER)
            error = self._gather()
        finally:
            self.seconds = time.monotonic() - began
        if error is not None:
            self._tell(self.keys.every_control, Drop(self.number))
        return self._finish(error)

    def _prepare(self) -> None:
        """The spy first: it finds a wrong problem before a thousand nodes do."""
        file = self.file.to_json()
        self._ask(self.keys.spy_control, Prepare(self.number, file, self.job.order.log))
        answers = self._ask(self.keys.every_control, Prepare(self.number, file), self.cells)
        fingerprints = {answer.note for answer in answers if isinstance(answer, Done)}
        if self.file.run.mode == "lockstep" and len(fingerprints) > 1:
            raise ClusterFailed(f"nodes differ, lockstep would not repeat: {' / '.join(sorted(fingerprints))}")
        self.versions = json.loads(min(fingerprints))

    def _gather(self) -> str | None:
        """Wait for the report of every cell, passing on wishes to stop and the deadline.

        Returns why a cell failed, if one did; the others are not waited for then.
        """
        rescued = self.file.run.mode == "lockstep"
        seconds = self.file.run.seconds
        deadline = None if seconds is None else self.job.order.submitted + seconds
        while len(self.reports) < self.cells:
            mail = self._next(deadline)
            if isinstance(mail, Wish):
                deadline = None if mail.reason == "deadline" else deadline
                # In async mode the root may have ended before others.
                root_ended = any(report.cell == ROOT for report in self.reports)
                key = self.keys.every_control if root_ended else self.keys.control(ROOT)
                self._tell(key, ProposeStop(self.number, mail.reason))
            elif isinstance(mail, Report):
                self.reports.append(mail)
                if mail.error is not None:
                    return mail.error
                if not rescued and mail.proposals:
                    # Without lockstep a lost message could leave a node that never hears of the stop.
                    self._tell(self.keys.every_control, ProposeStop(self.number, mail.proposals[0].reason))
                    rescued = True
        return None

    def _finish(self, error: str | None) -> Judgement:
        run = self.file.run
        champion = best_known(self.reports, run.spy)
        reasons = stop_reasons(self.reports, run.mode)
        states = tuple(states_of(self.reports).items())
        command = Finish(self.number, champion, stopped_after(self.reports), reasons, error, states)
        (answer,) = self._ask(self.keys.spy_control, command)
        if not isinstance(answer, Judged):
            raise ClusterFailed("the spy did not judge the run")
        return Judgement.of(answer)

    # Questions and answers --------------------------------------------------------------------------------------------
    def _ask(self, key: str, command: Command, expected: int = 1) -> list[Done | Judged]:
        """The answers of all that ``key`` reaches.

        Raises:
            BadInput: as the first refusal says.
            ClusterFailed: as the first refusal says, or because fewer answered than expected.
            _GivenUpError: if somebody wants the job to stop meanwhile.
        """
        question = next(self._questions)
        mail = self.job.mail

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                mail.put(_Answer(question, _decoded(reply.ok.payload.to_bytes())))

        self._get(key, command, direct(hear, lambda: mail.put(_Answer(question, None))), _ANSWER_WITHIN)
        answers: list[Done | Judged] = []
        while True:
            news = self._next()
            if isinstance(news, Wish):
                raise _GivenUpError(news)
            if not isinstance(news, _Answer) or news.question != question:
                continue
            if news.answer is None:
                break
            if isinstance(news.answer, Refused):
                blame = BadInput if news.answer.blame == "input" else ClusterFailed
                raise blame(news.answer.message)
            answers.append(news.answer)
        if len(answers) < expected:
            self._next(time.monotonic() + _DEATH_NOTICE)  # raises if a death explains it
            raise ClusterFailed(f"{len(answers)} of {expected} answered to {command.name!r}")
        return answers

    def _next(self, deadline: float | None = None) -> object:
        """The next mail; at the ``deadline`` the wish that it stands for.

        Raises:
            ClusterFailed: if the news is that the job cannot go on.
        """
        try:
            left = None if deadline is None else max(0.0, deadline - time.monotonic())
            mail = self.job.mail.get(timeout=left)
        except queue.Empty:
            return Wish("deadline")
        if isinstance(mail, Failure):
            self._cancelled = self._cancelled and mail.closing
            raise ClusterFailed(mail.message)
        if isinstance(mail, Wish):
            self._cancelled = self._cancelled or mail.reason == "cancel"
        return mail

    def _drop(self) -> None:
        """Let nodes and spy forget the job, if they still can hear."""
        with contextlib.suppress(zenoh.ZError):
            self._tell(self.keys.every_control, Drop(self.number))
            self._tell(self.keys.spy_control, Drop(self.number))

    def _tell(self, key: str, command: Command) -> None:
        """Send a command without waiting for the answers."""
        self._get(key, command, direct(lambda _: None), _ANSWER_WITHIN)

    def _get(self, key: str, command: Command, handler: Any, timeout: float) -> None:
        self.session.get(
            key,
            handler,
            payload=control.encode(command),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout,
        )

    # Called by Zenoh, on its thread -----------------------------------------------------------------------------------
    def _hear_report(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            return
        try:
            self.job.mail.put(Report.decode(reply.ok.payload.to_bytes()))
        except Rejected as error:
            self.job.mail.put(Failure(f"a node's report is not readable: {error.reason}"))

    def _hear_best(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            better = Improvement.decode(sample.payload.to_bytes())
            if better.job == self.number:
                self._improve(better)

    def _hear_statistics(self, sample: zenoh.Sample) -> None:
        with contextlib.suppress(Rejected):
            statistics = Statistics.decode(sample.payload.to_bytes())
            if statistics.job == self.number:
                self.job.tell(statistics)

    def _improve(self, better: Improvement) -> None:
        if self.best is None or better.fitness < self.best.fitness:
            self.best = better
            self.job.tell(better)


def _decoded(payload: bytes) -> Done | Judged | Refused:
    try:
        return control.decode_answer(payload)
    except Rejected as error:
        return Refused(f"an answer is not readable: {error.reason}")
