"""What a client knows of one job: improvements in order, whatever was lost, repeated or came late on the way.

Three sources tell of a job: `best` (each improvement, from the spy), `state` (each change of state, from the
coordinator) and the answer to `show`, which has the best so far and, at the end, the result. Any of the first two may
be missing while a router or a coordinator is restarted; the third is asked for when nothing has come for a while.
"""

import asyncio
import dataclasses
import math
from bisect import bisect_right
from collections import deque
from collections.abc import Mapping
from typing import Any

from coordinator.states import ENDS
from wire.jobs import JobState
from wire.news import Improvement

SEARCHING = "searching"
"""The state of a job that is kept alive, has stalled without an answer, and begins anew until it has one."""

BEGUN = frozenset({"running", SEARCHING})
"""States of a job after an epoch of its has begun."""

WAITING = "waiting"
"""The state of a job that has its answer and is kept alive for the next epoch."""

LOOK_EVERY = 1.0  # seconds without news
MOST_KEPT = 1000
"""Improvements of one job: it may be kept alive for days, and somebody may not read them."""

_RESULT_AFTER = 0.1  # seconds: nodes stop only after a deadline, and then there is a result


class JobFeed:
    """One job's news so far.

    Attributes:
        improvements: in order, each better than the one before or of a later epoch; of very many the latest.
        status: the last one heard of.
        begun: how often an epoch was heard to begin.
        answered: whether there will be no better answer.
        end: the answer to a brief `show` after the end.
        look_at: the time at which to ask for all there is to know, unless news comes before.
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
        self._early: list[Improvement] = []  # of any job, before this one's number is known
        self._pulse = asyncio.Event()

    async def news(self, seconds: float | None) -> None:
        """Wait until something has changed, but not longer than so many seconds."""
        pulse = self._pulse
        try:
            await asyncio.wait_for(pulse.wait(), seconds)
        except TimeoutError:
            return

    def wake(self) -> None:
        """Something has changed, for whoever waits."""
        self._pulse.set()
        self._pulse = asyncio.Event()

    def hear_best(self, better: Improvement, now: float) -> None:
        """The spy has published an improvement, of this job or of another."""
        if self.number is None:
            self._early.append(better)
        elif better.job == self.number:
            self._add(better)
            self.look_at = now + LOOK_EVERY
            self.wake()

    def hear_state(self, state: JobState, now: float) -> None:
        """The coordinator has published a change of a job's state."""
        if state.job != self.job:
            return
        self.begun += state.status in BEGUN
        self._know_number(state.number)
        self.status = state.status
        self.look_at = now if state.status in ENDS else now + LOOK_EVERY
        self.wake()

    def hear_view(self, view: Mapping[str, Any], now: float) -> None:
        """The coordinator has answered `show`.

        Args:
            view: the job, with a ``best`` that has become an `Improvement`, or None.
            now: the time.
        """
        best: Improvement | None = view["best"]
        number = view.get("number", None if best is None else best.job)
        if best is not None and self.number is None:
            self._early.append(best)
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
        """The first that is kept of those after ``last``; of all, without one."""
        place = 0 if last is None else bisect_right(self.improvements, _order(last), key=_order)
        return self.improvements[place] if place < len(self.improvements) else None

    def best(self, epoch: int) -> Improvement | None:
        """The best so far of that epoch or a later one."""
        if not self.improvements or self.improvements[-1].epoch < epoch:
            return None
        return self.improvements[-1]

    def answer(self, epoch: int) -> Improvement | None:
        """The best so far of that epoch or a later one that the planner's check accepts."""
        known = (each for each in reversed(self.improvements) if each.epoch >= epoch)
        return next((each for each in known if each.feasible), None)

    def _know_number(self, number: int) -> None:
        if self.number is None:
            self.number = number
            for better in sorted((each for each in self._early if each.job == number), key=_order):
                self._add(better)
            self._early.clear()

    def _add(self, better: Improvement) -> None:
        if not self.improvements or _order(better) > _order(self.improvements[-1]):
            self.improvements.append(better)


def _is_over(view: Mapping[str, Any]) -> bool:
    """Whether nothing more will be known of the job: after a deadline its nodes have still to stop."""
    draining = view["status"] == "deadline" and view.get("result") is None and view.get("ended") is None
    return view["status"] in ENDS and not draining


def _order(better: Improvement) -> tuple[int, float]:
    """Improvements grow by this: within an epoch each is fitter than those before."""
    return better.epoch, -better.fitness


def improvement_in(value: Mapping[str, Any]) -> Improvement:
    """The improvement that `show` tells of.

    Raises:
        KeyError, TypeError: if it is none.
    """
    names = [field.name for field in dataclasses.fields(Improvement)]
    values = {name: value[name] for name in names if name in value}
    if values["fitness"] is None:
        values["fitness"] = math.inf
    return Improvement(**values)
