"""A job lived through in this process, world by world, and judged as the spy does it.

What a coordinator does with processes is done here with `node.replay`: a job that stalls without an answer begins anew.
"""

import contextlib
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from genetics import Genomes
from node.fingerprint import fingerprint
from node.replay import World
from node.simulation import Outside, never
from problems import EvaluationFailed
from spy.collector import Collector
from spy.improvement_records import ImprovementRecord, records_of
from spy.judge import Judgement, judge
from spy.past import Lived, Past, stopped_after
from spy.result import Clocks, Result, result_of, states_of, stop_reasons
from wire.exchange import Champion
from wire.news import Improvement
from wire.report import Proposal, Report


class Listener:
    """Is told how a run goes; this one pays no heed."""

    def begins(self, world: World) -> None:
        """The next of its worlds begins."""

    def improvement(self, world: World, better: Improvement) -> None:
        """A champion was verified."""

    def lived(self, world: World, records: Sequence[ImprovementRecord]) -> None:
        """A world has ended, in which there were these improvements; before `ends`, if that is told of it."""

    def ends(self, world: World, judgement: Judgement, generation: int) -> None:
        """A world ended after that generation: the last one, or an attempt that stalled."""


class Simulation:
    """One run.

    Args:
        worlds: the first one; or all those of a run that is to be repeated.
        stops: how the last world of that run was stopped from outside; None if this is a run of its own, which may
            begin anew by itself.
        listener: is told of it.
        outside: asked in each generation whether somebody wants the run to stop.

    Attributes:
        file: the problem of the last world.
    """

    def __init__(
        self,
        worlds: Sequence[World],
        stops: Sequence[Proposal] | None = None,
        listener: Listener | None = None,
        outside: Outside = never,
    ) -> None:
        self.file = worlds[-1].file
        self._first, self._last = worlds[0], worlds[-1]
        self._known = deque(worlds)
        self._repeats = stops is not None
        self._stops = stops or ()
        self._listener = listener or Listener()
        self._outside = outside
        self._load_compiled_code()

    def run(self) -> Result:
        """What comes of it."""
        began, past = time.monotonic(), Past()
        best: Improvement | None = None
        demes: Genomes | None = None
        while True:
            world = self._known.popleft()
            attempt = _Attempt(world, best, self._listener)
            demes = attempt.live(demes, self._outside)
            if world is self._last:
                attempt.stop_as(self._stops)
            if attempt.error is None:
                self._listener.lived(world, records_of(past, attempt.lived))
            if attempt.error is None and self._known and not self._known[0].is_fresh:
                best = attempt.collector.best  # what else it knew the past keeps
            else:
                judgement = attempt.judged(past)
                if attempt.error is not None or not self._goes_on(attempt, judgement):
                    break
                best = judgement.best
            past = past.and_then(attempt.lived, self._known[0].why)
        clocks = Clocks(time.monotonic() - began, 0.0, time.process_time())
        self.file = world.file
        return result_of("1", self._first.file.run, past, attempt.lived, judgement, fingerprint(), clocks)

    def _goes_on(self, attempt: "_Attempt", judgement: Judgement) -> bool:
        """Whether there is another world, which is known then."""
        if self._repeats:
            return bool(self._known)
        if judgement.next_attempt is None:
            return False
        self._known.append(attempt.world.retried(stopped_after(attempt.reports), judgement.next_attempt))
        return True

    def _load_compiled_code(self) -> None:
        """Off the clock."""
        plan = self._last.plan
        with contextlib.suppress(EvaluationFailed):
            plan.evaluate(plan.coding.random(plan.keys(np.arange(1), 0), 1)[0])


class _Attempt:
    """One of the worlds; the spy's and the coordinator's part in it."""

    def __init__(self, world: World, best: Improvement | None, listener: Listener) -> None:
        self.world = world
        self.reports: list[Report] = []
        self.error: str | None = None
        self._listener = listener
        self._began = time.monotonic()
        if best is not None and not world.is_fresh:
            best = None if world.why.get("do") == "update" else best.carried_to(world.number)
        self.collector = Collector(world.plan, 1, best)
        listener.begins(world)

    @property
    def lived(self) -> Lived:
        """What is kept of it."""
        return Lived(self.world.file, self.reports, self.world.number)

    def live(self, demes: Genomes | None, outside: Outside) -> Genomes | None:
        """To its end, or until it is left; the demes that go on then."""
        try:
            if self.world.left_at is not None:
                self.reports, demes = self.world.leave(demes)
            else:
                self.reports = self.world.live(demes, lambda _, champion: self._hear(champion), outside)
        except EvaluationFailed as failure:
            self.error = str(failure)
        return demes

    def stop_as(self, stops: Sequence[Proposal]) -> None:
        """As if the root had proposed the stops that came from outside."""
        self.reports = [
            replace(report, proposals=(*report.proposals, *(each for each in stops if each.cell == report.cell)))
            for report in self.reports
        ]

    def judged(self, past: Past) -> Judgement:
        """What came of it."""
        self._hear(past.or_better(self.lived))
        generation = stopped_after(self.reports) if self.reports else 0
        reasons = stop_reasons(self.reports, self.world.file.run.mode)
        states = states_of(self.reports)
        judgement = judge(self.collector, generation, reasons, self.error, states, self.world.since)
        self._listener.ends(self.world, judgement, generation)
        return judgement

    def _hear(self, champion: Champion | None) -> None:
        better = self.collector.hear(champion, time.monotonic() - self._began)
        if better is not None:
            self._listener.improvement(self.world, better)
