"""One job, as whoever submitted it sees it."""

import queue
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from problems import ProblemFile
from spy.result import Result
from wire.news import Improvement, Statistics


@dataclass(frozen=True)
class Wish:
    """Somebody wants the job to stop."""

    reason: Literal["cancel", "deadline"]


@dataclass(frozen=True)
class Failure:
    """The job cannot go on: a process died, or (``closing``) the cluster is being closed."""

    message: str
    closing: bool = False


@dataclass(frozen=True)
class Order:
    """What was submitted."""

    number: int
    file: ProblemFile
    log: str | None
    submitted: float = field(default_factory=time.monotonic)


class Job:
    """A job of a `LocalCluster`."""

    def __init__(self, order: Order) -> None:
        self.order = order
        self._mail: queue.SimpleQueue[object] = queue.SimpleQueue()
        self._news: queue.SimpleQueue[Improvement | Statistics | None] = queue.SimpleQueue()
        self._ended = threading.Event()
        self._result: Result | None = None
        self._error: Exception | None = None

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
        """Wait for the end. If the cluster or the problem broke, the result's status is "failed" and it says why.

        Args:
            timeout: seconds.

        Raises:
            TimeoutError: if the job has not ended by then.
            BadInput: if the problem turns out to be wrong where its module is imported.
        """
        if not self._ended.wait(timeout):
            raise TimeoutError(f"job {self.order.number} has not ended within {timeout} s")
        if self._error is not None:
            raise self._error
        assert self._result is not None
        return self._result

    def cancel(self) -> None:
        """Ask all cells to stop; the result is the best so far, with status "cancelled"."""
        self._mail.put(Wish("cancel"))


class JobEntry(Job):
    """The same job, as the coordinator sees it."""

    @property
    def mail(self) -> "queue.SimpleQueue[object]":
        """What the coordinator is to know of while it conducts the job: `Wish`, `Failure`, answers and reports."""
        return self._mail

    def tell(self, event: Improvement | Statistics) -> None:
        """Pass on what happens."""
        self._news.put(event)

    def end(self, outcome: Result | Exception) -> None:
        """The job has ended, with a result or with the user's mistake."""
        if isinstance(outcome, Exception):
            self._error = outcome
        else:
            self._result = outcome
        self._ended.set()
        self._news.put(None)
