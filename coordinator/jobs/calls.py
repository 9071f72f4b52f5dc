"""Commands to nodes and to the spy, and the queue of one conductor: answers, reports, requests, news of deaths.

Zenoh's thread receives the answers and queues them like all other messages, so a conductor never waits in two places.
While it waits for the answers to one question it puts other messages off, except those that end the waiting: a failure,
a replaced process, and (where the caller allows it) a stop request.
"""

import contextlib
import itertools
import json
import queue
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import zenoh

from coordinator.errors import ClusterFailed
from coordinator.jobs.job import Failure, Moved, Replaced, Returned, StopRequest
from problems import BadInput
from wire import control, sessions
from wire.callbacks import direct
from wire.control import Command, Done, Drop, Finish, Judged, Look, Prepare, Refused, TellStates
from wire.news import Improvement
from wire.report import Report
from wire.seal import Seal
from wire.strict import Rejected
from wire.takeover import KeptStates

# Time limits in seconds. They are kept short where possible: Zenoh keeps some 800 bytes of each query until its time is
# over, even if it was answered long before.
_ANSWER_WITHIN = 60.0
_SOON = 2.0  # for the answers of cells of which some may be stopped: better most of them now than all of them later
_LONG = 600.0  # a problem may take long to prepare or to check; a dead process is noticed in other ways
_REPORT_WITHIN = 60.0  # after that reports are asked for again, so jobs may run for any time
_TOLD_WITHIN = 5.0
_DEATH_NOTICE = 1.0  # if an answer is missing, the news of a death that explains it may come this much later
# How long to ask again while a process, or the router that carries all questions, is replaced, or a host is out of
# reach: longer than a host may stay away (`coordinator.service.host_book.HOST_TIMEOUT`), after which the job fails.
_REPLACED_WITHIN = 150.0
ASK_AGAIN = 0.2  # a router that has died is back after about this time


Given = Done | Judged | KeptStates
"""An answer other than a refusal."""


@dataclass(frozen=True)
class _Answer:
    """An answer to question number ``question``; None when there will be no more."""

    question: int
    answer: Given | Refused | None


class Reported(NamedTuple):
    """A cell's report in an epoch; ``report`` is None when its ``question`` is over and brings no more reports."""

    question: int
    epoch: int
    report: Report | None


class StatesTold(NamedTuple):
    """A cell's answer to a question for states; ``kept`` is None when the ``question`` brings no more answers."""

    question: int
    kept: KeptStates | None


class GivenUpError(Exception):
    """A stop request came before any node had begun to breed."""

    def __init__(self, stop_request: StopRequest) -> None:
        super().__init__(stop_request.reason)
        self.stop_request = stop_request


class ReplacedError(Exception):
    """A process died and was replaced by a new one, which does not know the job.

    Attributes:
        node: the node; None for the spy.
    """

    def __init__(self, replaced: Replaced) -> None:
        super().__init__(replaced.node)
        self.node = replaced.node


class MovedError(Exception):
    """Cells are to go on on other nodes.

    Attributes:
        nodes: see `Moved`.
    """

    def __init__(self, moved: Moved) -> None:
        super().__init__(moved.nodes)
        self.nodes = moved.nodes


class HaltedError(Exception):
    """Cells are halted in the latest epoch, and who halted them did not begin another one.

    That was a coordinator that died, or this one, which was interrupted by a death and let the dead go on exactly.
    """


class _ReturnedError(Exception):
    """A node that was cut off is back."""


class FailedError(ClusterFailed):
    """The job cannot go on, whatever the conductor is doing: see `Failure`."""


class RefusedError(ClusterFailed):
    """A process refuses a command, for no reason of the user's."""


class Calls:
    """The questions and the queue of one job.

    The conductor's thread alone calls the methods; only the queue is shared with other threads.

    Args:
        session: a Zenoh session through the router.
        seal: signs the commands.
        queue: the job's queue.
        replaces: whether dead processes are replaced, so that it is worth asking again.

    Attributes:
        closing: whether the failure that ended the job was that the cluster is being closed.
    """

    def __init__(self, session: zenoh.Session, seal: Seal, queue: "queue.SimpleQueue[object]", replaces: bool) -> None:
        self.session = session
        self._seal = seal
        self.queue = queue
        self._replaces = replaces
        self._put_off: deque[object] = deque()
        self._questions = itertools.count()
        self.closing = False

    def ask(
        self,
        questions: Sequence[tuple[str, Command]],
        expected: int = 1,
        give_up: bool = True,
        *,
        for_nodes_back: bool = False,
    ) -> list[Given]:
        """Send commands and return the answers of all processes that they reach.

        If too few processes answer, all are asked again for as long as a replacement may take; so commands must be
        idempotent.

        Args:
            questions: keys with commands, sent all at once.
            expected: the number of answers to wait for.
            give_up: whether a stop request ends the waiting.
            for_nodes_back: whether to ask all again as soon as a node is back that was cut off; else only once those
                that were reached have answered, though each of them may wait for that node.

        Raises:
            BadInput: if a process refuses and blames the input.
            ClusterFailed: if a process refuses for another reason, or fewer answer than expected.
            GivenUpError: if a stop request comes meanwhile, and ``give_up``.
            ReplacedError: if a process dies meanwhile.
        """
        until = time.monotonic() + (_REPLACED_WITHIN if self._replaces else 0.0)
        while True:
            try:
                answers = self._ask_once(questions, give_up, for_nodes_back)
            except _ReturnedError:  # others return with it: a moment later one question reaches them all
                answers, until = [], time.monotonic() + _REPLACED_WITHIN
            if len(answers) >= expected:
                return answers
            # If the router has died there is no news at all, so this asks again. If a process has died, this raises.
            self._wait_for_news_of_a_death(ASK_AGAIN if self._replaces else _DEATH_NOTICE, give_up)
            if time.monotonic() >= until:
                raise ClusterFailed(
                    f"only {len(answers)} of {expected} processes answered the command {questions[0][1].name!r}"
                )

    def _ask_once(self, questions: Sequence[tuple[str, Command]], give_up: bool, for_nodes_back: bool) -> list[Given]:
        number = next(self._questions)
        queue = self.queue

        def hear(reply: zenoh.Reply) -> None:  # on Zenoh's thread
            if reply.ok is not None:
                queue.put(_Answer(number, _decoded(reply.ok.payload.to_bytes())))

        if give_up:
            self._raise_stop_put_off()
        for key, command in questions:
            self._get(key, command, direct(hear, lambda: queue.put(_Answer(number, None))), _answered_within(command))
        return self._answers(number, len(questions), give_up, for_nodes_back)

    def _raise_stop_put_off(self) -> None:
        stop_request = next((each for each in self._put_off if isinstance(each, StopRequest)), None)
        if stop_request is not None:
            raise GivenUpError(stop_request)

    def _answers(self, number: int, open_questions: int, give_up: bool, for_nodes_back: bool) -> list[Given]:
        answers: list[Given] = []
        while open_questions:
            news = self._take(None)
            if isinstance(news, Replaced):
                raise ReplacedError(news)
            if isinstance(news, StopRequest) and give_up:
                raise GivenUpError(news)
            if not isinstance(news, _Answer):
                self._put_off.append(news)  # a node that is back may have missed an earlier question as well
                if isinstance(news, Returned) and for_nodes_back:
                    raise _ReturnedError
                continue
            if news.question != number:  # a late answer to an earlier question, whose waiting was ended
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
            # Only the spy says so, if it was replaced. Its liveliness token will report the same later.
            return ReplacedError(Replaced(None))
        return RefusedError(answer.message)

    def _wait_for_news_of_a_death(self, seconds: float, give_up: bool) -> None:
        """Wait for so long, and raise if a process was replaced meanwhile; other messages are put off."""
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
        """Have the report of each cell that ``key`` reaches queued once it stops; return the question's number."""
        question, queue, epoch = next(self._questions), self.queue, command.epoch

        def hear(reply: zenoh.Reply) -> None:  # on Zenoh's thread
            if reply.ok is None:
                return
            try:
                queue.put(Reported(question, epoch, Report.decode(reply.ok.payload.to_bytes())))
            except Rejected as error:
                queue.put(Failure(f"a node's report is not readable: {error.reason}"))

        self._get(key, command, direct(hear, lambda: queue.put(Reported(question, epoch, None))), _REPORT_WITHIN)
        return question

    def ask_for_states(self, key: str, command: control.TellStates) -> int:
        """Have the answers of the cells that ``key`` reaches queued; return the question's number."""
        question, queue = next(self._questions), self.queue

        def hear(reply: zenoh.Reply) -> None:  # on Zenoh's thread
            if reply.ok is not None and isinstance(kept := _decoded(reply.ok.payload.to_bytes()), KeptStates):
                queue.put(StatesTold(question, kept))

        self._get(key, command, direct(hear, lambda: queue.put(StatesTold(question, None))), _ANSWER_WITHIN)
        return question

    def tell(self, key: str, command: Command) -> None:
        """Send a command without waiting for the answers."""
        tell(self.session, self._seal, key, command)

    def best_told(self, key: str, job: int) -> Improvement | None:
        """Return what the function `best_told` does, or None if the cluster is being closed."""
        if not self.closing:
            with contextlib.suppress(zenoh.ZError):  # the session may be closed
                return best_told(self.session, self._seal, key, job)
        return None

    def next(self, deadline: float | None = None) -> object:
        """Return the next message, put-off ones first; None if there is none by ``deadline`` (monotonic clock).

        Raises:
            FailedError: if the message is that the job cannot continue.
        """
        return self._put_off.popleft() if self._put_off else self._take(deadline)

    def wait(self, seconds: float) -> None:
        """Wait for so many seconds; messages are put off.

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
            raise FailedError(message.message)
        return message

    def put_off(self, message: object) -> None:
        """Keep a message for later calls of `next`."""
        self._put_off.append(message)

    def _get(self, key: str, command: Command, handler: Any, timeout: float) -> None:
        _get(self.session, self._seal, key, command, handler, timeout)


def tell(session: zenoh.Session, seal: Seal, key: str, command: Command) -> None:
    """Send a command to all processes that ``key`` reaches, without waiting for the answers. Any thread may call it."""
    _get(session, seal, key, command, direct(lambda _: None), _TOLD_WITHIN)


def best_told(session: zenoh.Session, seal: Seal, key: str, job: int) -> Improvement | None:
    """Return the best answer of a job that the spy has told, and have it forget the job, so that it tells no other.

    It is None if the spy knows none, or does not answer soon.

    Args:
        session: a session of the coordinator.
        seal: signs the question.
        key: the key of the spy's commands.
        job: the job's number.
    """
    payload = seal.close(key, control.encode(Drop(job)))
    for reply in session.get(key, payload=payload, timeout=_SOON):
        if reply.ok is None:
            continue
        with contextlib.suppress(Rejected, TypeError, ValueError):
            answer = control.decode_answer(reply.ok.payload.to_bytes())
            if isinstance(answer, Done):
                return Improvement.decode(bytes.fromhex(json.loads(answer.note)))
    return None


def better_of(best: Improvement | None, told: Improvement | None, epoch: int) -> Improvement | None:
    """Return the better of the best answer that is known and one that the spy has told, if that is of this epoch."""
    if told is not None and told.epoch > epoch and told.seconds == 0.0:
        # It was carried to an epoch that has not begun, see `Improvement.carried_to`.
        told = replace(told, epoch=epoch)
    if told is None or told.epoch != epoch or (best is not None and told.order <= best.order):
        return best
    return told


def _get(session: zenoh.Session, seal: Seal, key: str, command: Command, handler: Any, timeout: float) -> None:
    # By default Zenoh may ask only one queryable, and keeps only the latest reply of each key; here each of perhaps a
    # thousand nodes is asked by one key, and all answers count.
    session.get(
        key,
        handler,
        payload=seal.close(key, control.encode(command)),
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout,
        priority=sessions.LONG_ANSWER if isinstance(command, TellStates) else zenoh.Priority.DATA,
    )


def _answered_within(command: Command) -> float:
    """Return how many seconds to wait for the answers to a command."""
    if isinstance(command, Prepare | Finish):
        return _LONG
    return _SOON if isinstance(command, Look | TellStates) else _ANSWER_WITHIN


def _decoded(payload: bytes) -> Given | Refused:
    try:
        return control.decode_answer(payload)
    except Rejected as error:
        return Refused(f"an answer is not readable: {error.reason}")
