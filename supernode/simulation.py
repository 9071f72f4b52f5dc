"""A job simulated in this process, for the command `simulate` and for Python; judged as the spy does it.

What a coordinator does with processes is done here with `node.replay`: a job that stalls without an answer begins anew.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from coordinator.consulting import Consulting
from genetics import Fitness, Genomes
from node.fingerprint import fingerprint
from node.replay import Epoch, epochs_of
from node.simulation import Outside, Snapshot, StopRequest, ignore, never
from problems import BadInput, EvaluationFailed, Problem, ProblemFile, load, registry
from problems.made import MadeProblem
from spy.collector import Collector
from spy.improvement_records import ImprovementRecord, records_of
from spy.past import Lived, Past, stopped_after
from spy.result import Clocks, Result, result_of, states_of, stop_reasons
from spy.verification import Judgement, verify
from wire.exchange import Champion
from wire.news import Improvement
from wire.report import Proposal, Reason, Report


@dataclass(frozen=True)
class Generation:
    """What a callback of `simulate` is told of a generation.

    Attributes:
        number: from 0, the first demes, on; generations of earlier attempts count.
        attempt: how often the run has begun anew.
        genomes: all demes, shape (cells, deme, genome_bytes), uint8; a copy.
        fitness: theirs, shape (cells, deme), +inf where infeasible; a copy.
        best: the best verified individual that the root cell has heard of, decoded; None before the first.
    """

    number: int
    attempt: int
    genomes: Genomes
    fitness: Fitness
    best: Improvement | None


Callback = Callable[[Generation], object]
"""Called in each generation; the run stops if it returns a true value."""


def simulate(problem: ProblemFile | Problem | str | Path, *, callback: Callback | None = None, **run: Any) -> Result:
    """Run a job in this process, bit-identical to a run of processes in lockstep.

    Args:
        problem: from `load`, the path of a problem file, or a problem made in Python.
        callback: called in each generation, see `Generation`; the run is cancelled if it returns a true value.
        run: settings that replace those of the file's ``[run]`` table, such as ``seed=1``, ``torus="8x8"``.

    Raises:
        BadInput: if the problem or a setting is wrong, or a callback is given for an asynchronous run, which has no
            common generation.
    """
    if isinstance(problem, Problem):
        file: ProblemFile = MadeProblem.of(problem)
    else:
        file = problem if isinstance(problem, ProblemFile) else load(problem)
    file = file.with_run(**run)
    file.refuse_unreachable()
    if callback is not None and file.run.mode != "lockstep":
        raise BadInput(f"callback: expected mode lockstep, which has common generations, found {file.run.mode}")
    request = StopRequest(file.run.seconds)
    told = None if callback is None else _Told(callback, request)
    simulation = Simulation(epochs_of(file), None, told, request.reason, ignore if told is None else told.see)
    request.began = time.monotonic()
    return simulation.run()


class Listener:
    """Is told how a run goes; this one pays no heed."""

    def begins(self, epoch: Epoch) -> None:
        """The next of its epochs begins."""

    def improvement(self, epoch: Epoch, better: Improvement) -> None:
        """A champion was verified."""

    def lived(self, epoch: Epoch, records: Sequence[ImprovementRecord]) -> None:
        """An epoch has ended, in which there were these improvements; before `ends`, if that is told of it."""

    def ends(self, epoch: Epoch, judgement: Judgement, generation: int) -> None:
        """An epoch ended after that generation: the last one, or an attempt that stalled."""


class _Told(Listener):
    """Calls a callback."""

    def __init__(self, callback: Callback, request: StopRequest) -> None:
        self._callback, self._wish = callback, request
        self._best: Improvement | None = None
        self._since = self._attempt = 0

    def begins(self, epoch: Epoch) -> None:
        self._since, self._attempt = epoch.since, epoch.file.attempt

    def improvement(self, epoch: Epoch, better: Improvement) -> None:
        if self._best is None or better.fitness < self._best.fitness:
            self._best = better

    def see(self, generation: int, genomes: Genomes, fitness: Fitness) -> None:
        """A generation of the epoch that began last."""
        number = self._since + generation
        if self._callback(Generation(number, self._attempt, genomes.copy(), fitness.copy(), self._best)):
            self._wish.cancelled = True


class Simulation:
    """One run.

    Args:
        epochs: the first one; or all those of a run that is to be repeated.
        stops: how the last epoch of that run was stopped from outside; None if this is a run of its own, which may
            begin anew by itself.
        listener: is told of it.
        outside: asked in each generation whether somebody wants the run to stop.
        snapshot: sees each generation of each attempt, in lockstep.

    Attributes:
        file: the problem of the last epoch.
    """

    def __init__(
        self,
        epochs: Sequence[Epoch],
        stops: Sequence[Proposal] | None = None,
        listener: Listener | None = None,
        outside: Outside = never,
        snapshot: Snapshot = ignore,
    ) -> None:
        self.file = epochs[-1].file
        self._first, self._last = epochs[0], epochs[-1]
        self._known = deque(epochs)
        self._repeats = stops is not None
        self._stops = stops or ()
        self._listener = listener or Listener()
        self._outside, self._snapshot = outside, snapshot
        self._oracle = Consulting()
        self._load_compiled_code()

    def run(self) -> Result:
        """What comes of it."""
        try:
            return self._run()
        finally:
            self._oracle.close()

    def _run(self) -> Result:
        began, past = time.monotonic(), Past()
        best: Improvement | None = None
        demes: Genomes | None = None
        while True:
            epoch = self._known.popleft()
            attempt = _Attempt(epoch, best, self._listener)
            if not self._repeats and _can_be_asked(epoch.file):
                self._oracle.turn_to(epoch.file)
            demes = attempt.live(demes, self._why_to_stop, self._snapshot)
            if epoch is self._last:
                attempt.stop_as(self._stops)
            if attempt.error is None:
                self._listener.lived(epoch, records_of(past, attempt.lived))
            if attempt.error is None and self._known and not self._known[0].is_fresh:
                best = attempt.collector.best  # what else it knew the past keeps
            else:
                judgement = attempt.verified(past)
                if attempt.error is not None or not self._goes_on(attempt, judgement):
                    break
                best = judgement.best
            past = past.and_then(attempt.lived, self._known[0].why)
        clocks = Clocks(time.monotonic() - began, 0.0, time.process_time())
        self.file = epoch.file
        judgement = self._with_the_oracle(replace(judgement, next_attempt=None))
        return result_of("1", self._first.file.run, past, attempt.lived, judgement, fingerprint(), clocks)

    def _goes_on(self, attempt: "_Attempt", judgement: Judgement) -> bool:
        """Whether there is another epoch, which is known then."""
        if self._repeats:
            return bool(self._known)
        if judgement.next_attempt is None or self._oracle.is_hopeless:
            return False
        if judgement.has_oracle:
            self._oracle.ask()
        self._known.append(attempt.epoch.retried(stopped_after(attempt.reports), judgement.next_attempt))
        return True

    def _why_to_stop(self) -> Reason | None:
        """Whether somebody outside wants an end, or the oracle has found that there is no way."""
        reason = self._outside()
        if reason is None:
            self._oracle.look()
        return "infeasible" if reason is None and self._oracle.is_hopeless else reason

    def _with_the_oracle(self, judgement: Judgement) -> Judgement:
        """The judgement with what the oracle says, of a run that has stalled for good, or ended as hopeless."""
        if not judgement.is_open or not _can_be_asked(self.file):
            return judgement
        self._oracle.turn_to(self.file)
        self._oracle.ask()
        while (look_at := self._oracle.look_at) is not None and self._outside() is None:
            threading.Event().wait(max(0.0, look_at - time.monotonic()))
            self._oracle.look()
        foretold = self._oracle.foretold
        return judgement if foretold is None else judgement.in_the_light_of(foretold)

    def _load_compiled_code(self) -> None:
        """Off the clock."""
        plan = self._last.plan
        with contextlib.suppress(EvaluationFailed):
            plan.evaluate(plan.coding.random(plan.keys(np.arange(1), 0), 1)[0])


def _can_be_asked(file: ProblemFile) -> bool:
    """Whether another process can make the problem: the class of one made in Python need not be in a module."""
    return registry.is_built_in(file.kind) or not isinstance(file, MadeProblem)


class _Attempt:
    """One of the epochs; the spy's and the coordinator's part in it."""

    def __init__(self, epoch: Epoch, best: Improvement | None, listener: Listener) -> None:
        self.epoch = epoch
        self.reports: list[Report] = []
        self.error: str | None = None
        self._listener = listener
        self._began = time.monotonic()
        if best is not None and not epoch.is_fresh:
            best = None if epoch.why.get("do") == "update" else best.carried_to(epoch.number)
        self.collector = Collector(epoch.plan, 1, best)
        listener.begins(epoch)

    @property
    def lived(self) -> Lived:
        """What is kept of it."""
        return Lived(self.epoch.file, self.reports, self.epoch.number)

    def live(self, demes: Genomes | None, outside: Outside, snapshot: Snapshot) -> Genomes | None:
        """To its end, or until it is left; the demes that go on then."""
        try:
            if self.epoch.left_at is not None:
                self.reports, demes = self.epoch.leave(demes)
            else:
                self.reports = self.epoch.live(demes, lambda _, champion: self._hear(champion), outside, snapshot)
        except EvaluationFailed as failure:
            self.error = str(failure)
        return demes

    def stop_as(self, stops: Sequence[Proposal]) -> None:
        """As if the root had proposed the stops that came from outside."""
        self.reports = [
            replace(report, proposals=(*report.proposals, *(each for each in stops if each.cell == report.cell)))
            for report in self.reports
        ]

    def verified(self, past: Past) -> Judgement:
        """What came of it."""
        self._hear(past.or_better(self.lived))
        generation = stopped_after(self.reports) if self.reports else 0
        reasons = stop_reasons(self.reports, self.epoch.file.run.mode)
        states = states_of(self.reports)
        judgement = verify(self.collector, generation, reasons, self.error, states, self.epoch.since)
        self._listener.ends(self.epoch, judgement, generation)
        return judgement

    def _hear(self, champion: Champion | None) -> None:
        better = self.collector.hear(champion, time.monotonic() - self._began)
        if better is not None:
            self._listener.improvement(self.epoch, better)
