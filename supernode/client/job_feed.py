"""What a client knows of one job: its improvements in order, although messages get lost, repeated and delayed.

Three sources report on a job: `best` (each improvement, published by the spy), `state` (each change of state, published
by the coordinator) and the answer to `show`, which holds the best so far and, at the end, the result. Messages of the
first two may be missing while a router or a coordinator restarts. When nothing has come for a while, the client asks
with `show`.
"""

import asyncio
import dataclasses
import math
from bisect import bisect_right
from collections import deque
from collections.abc import Mapping
from operator import attrgetter
from typing import Any

from coordinator.jobs.states import ENDS
from wire.jobs import JobState
from wire.news import Improvement

SEARCHING = "searching"
"""The state of a job that is kept alive, has stalled without an answer, and restarts until it has one."""

BEGUN = frozenset({"running", SEARCHING})
"""States that a job enters when an epoch of it begins."""

WAITING = "waiting"
"""The state of a job that has its answer and is kept alive until it is updated."""

LOOK_EVERY = 1.0  # seconds without a message after which the cluster is asked
MOST_KEPT = 1000
"""Improvements kept of one job: it may be kept alive for days while the program does not read them."""

_ORDER = attrgetter("order")
_RESULT_AFTER = 0.1  # seconds until the next question after a job's end: its nodes have to stop before it has a result


class JobFeed:
    """What a client knows of one job so far. Only the client's loop may touch it.

    Attributes:
        job: the job's id.
        number: the number by which improvements name the job; None until a state or an answer has told it.
        improvements: in order, each better than the one before or of a later epoch; the latest `MOST_KEPT`.
        status: the last known state; None before the first.
        begun: how many epochs are known to have begun.
        answered: whether the answer to `show` said that the job has ended.
        end: the answer to `show` after which nothing more will be known; None before.
        look_at: the loop's time at which to ask the cluster, unless a message arrives before.
        looking: the question that is under way, if one is.
        error: why the last question failed, if it did.
    """

    def __init__(self, job: str, now: float) -> None:
        self.job = job
        self.number: int | None = None
        self.improvements: deque[Improvement] = deque(maxlen=MOST_KEPT)
        self.status: str | None = None
        self.begun = 0
        self.answered = False
        self.end: Mapping[str, Any] | None = None
        self.look_at = now
        self.looking: asyncio.Task[None] | None = None
        self.error: Exception | None = None
        self._early: list[Improvement] = []  # of any job, received before this job's number was known
        self._pulse = asyncio.Event()  # set once, by the next change, and then replaced: it wakes all who wait now

    async def news(self, seconds: float | None) -> None:
        """Wait until something changes, but at most ``seconds`` (None: no limit)."""
        pulse = self._pulse
        try:
            await asyncio.wait_for(pulse.wait(), seconds)
        except TimeoutError:
            return

    def wake(self) -> None:
        """Wake everything that waits in `news`."""
        self._pulse.set()
        self._pulse = asyncio.Event()

    def hear_best(self, better: Improvement, now: float) -> None:
        """Take an improvement that the spy has published, of this job or another one."""
        if self.number is None:
            self._early.append(better)
        elif better.job == self.number:
            self._add(better)
            self.look_at = now + LOOK_EVERY
            self.wake()

    def hear_state(self, state: JobState, now: float) -> None:
        """Take a change of a job's state that the coordinator has published."""
        if state.job != self.job:
            return
        self.begun += state.status in BEGUN
        self._know_number(state.number)
        self.status = state.status
        # At the end ask at once: the state alone does not hold the result.
        self.look_at = now if state.status in ENDS else now + LOOK_EVERY
        self.wake()

    def hear_view(self, view: Mapping[str, Any], now: float) -> None:
        """Take the coordinator's answer to `show`.

        Args:
            view: the answer, in which ``best`` is an `Improvement` or None.
            now: the loop's time.
        """
        best: Improvement | None = view["best"]
        number = view.get("number", None if best is None else best.job)
        if best is not None and self.number is None:
            self._early.append(best)  # `_know_number` sorts it in
        if number is not None:
            self._know_number(number)
        if best is not None:
            self._add(best)
        self.status = str(view["status"])
        self.answered = self.status in ENDS
        if _is_over(view):
            self.end = view
        self.look_at = now + (LOOK_EVERY if self.status not in ENDS else _RESULT_AFTER)
        self.wake()

    def after(self, last: Improvement | None) -> Improvement | None:
        """Return the first kept improvement after ``last``, or the first of all if ``last`` is None."""
        # By order, not by identity: ``last`` may have been dropped from the front since.
        place = 0 if last is None else bisect_right(self.improvements, last.order, key=_ORDER)
        return self.improvements[place] if place < len(self.improvements) else None

    def best(self, epoch: int) -> Improvement | None:
        """Return the best improvement of ``epoch`` or later; None if there is none."""
        if not self.improvements or self.improvements[-1].epoch < epoch:
            return None
        return self.improvements[-1]

    def answer(self, epoch: int) -> Improvement | None:
        """Return the best improvement of ``epoch`` or later that the planner's check accepts; None if there is none."""
        known = (each for each in reversed(self.improvements) if each.epoch >= epoch)
        return next((each for each in known if each.feasible), None)

    def _know_number(self, number: int) -> None:
        if self.number is None:
            self.number = number
            for better in sorted((each for each in self._early if each.job == number), key=_ORDER):
                self._add(better)
            self._early.clear()

    def _add(self, better: Improvement) -> None:
        # Late and repeated ones are not better than the last one kept: they are dropped.
        if not self.improvements or better.order > self.improvements[-1].order:
            self.improvements.append(better)


def _is_over(view: Mapping[str, Any]) -> bool:
    """Return whether nothing more will be known of the job; after a deadline its nodes have to stop first."""
    draining = view["status"] == "deadline" and view.get("result") is None and view.get("ended") is None
    return view["status"] in ENDS and not draining


def improvement_in(value: Mapping[str, Any]) -> Improvement:
    """Return the improvement that an answer to `show` holds.

    Raises:
        KeyError, TypeError: if ``value`` does not hold one.
    """
    names = [field.name for field in dataclasses.fields(Improvement)]
    values = {name: value[name] for name in names if name in value}
    if values["fitness"] is None:  # the wire has no infinity
        values["fitness"] = math.inf
    return Improvement(**values)
