"""Questions to nodes and to the spy, and the one queue that a conductor waits at: answers, reports, requests, news.

Answers come by Zenoh's thread and are queued like everything else, so a conductor never waits in two places. While it
waits for the answers to one question, other messages are put off, but for what ends the waiting.
"""

import itertools
import queue
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import zenoh

from coordinator.errors import ClusterFailed
from coordinator.job import Failure, Replaced, StopRequest
from problems import BadInput
from wire import control
from wire.callbacks import direct
from wire.control import Command, Done, Finish, Judged, Prepare, Refused
from wire.report import Report
from wire.seal import Seal
from wire.strict import Rejected

# Seconds. Each query keeps some 800 bytes until its time is over, even when it was answered long before.
_ANSWER_WITHIN = 60.0
_LONG = 600.0  # a problem may have much to prepare, or to check, and a dead process is heard of otherwise
_REPORT_WITHIN = 60.0  # then reports are asked for again
_TOLD_WITHIN = 5.0
_DEATH_NOTICE = 1.0  # seconds: an answer that never comes may be explained this much later
_REPLACED_WITHIN = 60.0  # seconds: a dead process, or the router, by which all questions go
ASK_AGAIN = 0.2  # seconds: a router that has died is there again after about so long


@dataclass(frozen=True)
class _Answer:
    """To question number ``question``; None when there will be no more."""

    question: int
    answer: Done | Judged | Refused | None


Given = Done | Judged
"""An answer that is no refusal."""


class Reported(NamedTuple):
    """A cell has stopped in an epoch; None when no more reports will come by the question that asked for them."""

    question: int
    epoch: int
    report: Report | None


class GivenUpError(Exception):
    """Somebody wants the job to stop while nobody breeds yet, or no longer."""

    def __init__(self, stop_request: StopRequest) -> None:
        super().__init__(stop_request.reason)
        self.stop_request = stop_request


class ReplacedError(Exception):
    """A process died that was to answer; another one lives in its place."""

    def __init__(self, replaced: Replaced) -> None:
        super().__init__(replaced.node)
        self.node = replaced.node


class Calls:
    """The questions and the queue of one job.

    Args:
        session: through the router.
        seal: of the cluster.
        queue: the job's.
        replaces: whether dead processes are replaced, so that it is worth waiting for one.
    """

    def __init__(self, session: zenoh.Session, seal: Seal, queue: "queue.SimpleQueue[object]", replaces: bool) -> None:
        self.session = session
        self._seal = seal
        self.queue = queue
        self._replaces = replaces
        self._put_off: deque[object] = deque()
        self._questions = itertools.count()
        self.closing = False

    def ask(self, questions: Sequence[tuple[str, Command]], expected: int = 1, give_up: bool = True) -> list[Given]:
        """The answers of all that the ``questions``, keys with commands, reach.

        Args:
            questions: asked all at once.
            expected: how many are to answer.
            give_up: whether a request to stop ends the waiting.

        Raises:
            BadInput: as the first refusal says.
            ClusterFailed: as the first refusal says, or because fewer answered than expected.
            GivenUpError: if somebody wants the job to stop meanwhile.
            ReplacedError: if a process died meanwhile.
        """
        until = time.monotonic() + (_REPLACED_WITHIN if self._replaces else 0.0)
        while True:
            answers = self._ask_once(questions, give_up)
            if len(answers) >= expected:
                return answers
            self._wait_for_news_of_a_death(ASK_AGAIN if self._replaces else _DEATH_NOTICE, give_up)
            if time.monotonic() >= until:
                raise ClusterFailed(f"{len(answers)} of {expected} answered to {questions[0][1].name!r}")

    def _ask_once(self, questions: Sequence[tuple[str, Command]], give_up: bool) -> list[Given]:
        number = next(self._questions)
        queue = self.queue

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                queue.put(_Answer(number, _decoded(reply.ok.payload.to_bytes())))

        if give_up:
            self._raise_wish_put_off()
        for key, command in questions:
            within = _LONG if isinstance(command, Prepare | Finish) else _ANSWER_WITHIN
            self._get(key, command, direct(hear, lambda: queue.put(_Answer(number, None))), within)
        return self._answers(number, len(questions), give_up)

    def _raise_wish_put_off(self) -> None:
        stop_request = next((each for each in self._put_off if isinstance(each, StopRequest)), None)
        if stop_request is not None:
            raise GivenUpError(stop_request)

    def _answers(self, number: int, open_questions: int, give_up: bool) -> list[Given]:
        answers: list[Given] = []
        while open_questions:
            news = self._take(None)
            if isinstance(news, Replaced):
                raise ReplacedError(news)
            if isinstance(news, StopRequest) and give_up:
                raise GivenUpError(news)
            if not isinstance(news, _Answer):
                self._put_off.append(news)
                continue
            if news.question != number:
                continue
            if news.answer is None:
                open_questions -= 1
            elif isinstance(news.answer, Refused):
                raise self._refusal(news.answer)
            else:
                answers.append(news.answer)
        return answers

    def _refusal(self, answer: Refused) -> Exception:
        if answer.blame == "input":
            return BadInput(answer.message)
        if answer.blame == "stranger" and self._replaces:
            return ReplacedError(Replaced(None))  # the news of that are on their way
        return ClusterFailed(answer.message)

    def _wait_for_news_of_a_death(self, seconds: float, give_up: bool) -> None:
        """Raises if there is any."""
        deadline = time.monotonic() + seconds
        while True:
            news = self._take(deadline)
            if news is None:
                return
            if isinstance(news, Replaced):
                raise ReplacedError(news)
            if isinstance(news, StopRequest) and give_up:
                raise GivenUpError(news)
            self._put_off.append(news)

    def ask_for_reports(self, key: str, command: control.Begin | control.Halt) -> int:
        """Let the report of each cell that ``key`` reaches be queued, once it stops; returns the question's number."""
        question, queue, epoch = next(self._questions), self.queue, command.epoch

        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is None:
                return
            try:
                queue.put(Reported(question, epoch, Report.decode(reply.ok.payload.to_bytes())))
            except Rejected as error:
                queue.put(Failure(f"a node's report is not readable: {error.reason}"))

        self._get(key, command, direct(hear, lambda: queue.put(Reported(question, epoch, None))), _REPORT_WITHIN)
        return question

    def tell(self, key: str, command: Command) -> None:
        """Send a command without waiting for the answers."""
        self._get(key, command, direct(lambda _: None), _TOLD_WITHIN)

    def next(self, deadline: float | None = None) -> object:
        """The next message; None at the ``deadline``.

        Raises:
            ClusterFailed: if the news is that the job cannot go on.
        """
        return self._put_off.popleft() if self._put_off else self._take(deadline)

    def wait(self, seconds: float) -> None:
        """Let some time go by; messages are put off.

        Raises:
            ReplacedError: if a process dies meanwhile.
        """
        self._wait_for_news_of_a_death(seconds, give_up=False)

    def _take(self, deadline: float | None) -> object:
        try:
            left = None if deadline is None else max(0.0, deadline - time.monotonic())
            message = self.queue.get(timeout=left)
        except queue.Empty:
            return None
        if isinstance(message, Failure):
            self.closing = message.closing
            raise ClusterFailed(message.message)
        return message

    def put_off(self, message: object) -> None:
        """Come back to it after what has come meanwhile."""
        self._put_off.append(message)

    def _get(self, key: str, command: Command, handler: Any, timeout: float) -> None:
        self.session.get(
            key,
            handler,
            payload=self._seal.close(key, control.encode(command)),
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=timeout,
        )


def _decoded(payload: bytes) -> Done | Judged | Refused:
    try:
        return control.decode_answer(payload)
    except Rejected as error:
        return Refused(f"an answer is not readable: {error.reason}")
