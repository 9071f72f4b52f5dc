"""Simulate a job in this process, for the command `simulate` and for Python programs.

Nodes are simulated by `node.replay`. The parts of the spy (verification) and of the coordinator (restarts, the oracle,
the result) run here too, so that a simulation returns the same result as a run of processes.
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

from coordinator.jobs.consulting import Consulting
from genetics import Fitness, Genomes
from node.fingerprint import fingerprint
from node.replay import Epoch, epochs_of
from node.simulation import Outside, Snapshot, StopRequest, ignore, never
from problems import BadInput, EvaluationFailed, Problem, ProblemFile, registry
from problems.in_memory import InMemoryProblem, file_of
from spy.collector import Collector
from spy.improvement_records import ImprovementRecord, records_of
from spy.judgement import Judgement
from spy.past import Lived, Past, stopped_after
from spy.result import Clocks, Result, result_of, states_of, stop_reasons
from spy.verification import verify
from wire.champion import Champion
from wire.news import Improvement
from wire.report import Proposal, Reason, Report


@dataclass(frozen=True)
class Generation:
    """One generation of a run, as the callback of `simulate` receives it.

    Attributes:
        number: counts from 0 (the initial individuals), through all attempts of the run.
        attempt: how often the run has begun anew; 0 in the first attempt.
        genomes: all individuals, shape (cells, deme, genome_bytes), uint8; a copy.
        fitness: their fitness, shape (cells, deme); lower is better, +inf where infeasible; a copy.
        best: the best verified improvement that the root cell knows of, decoded; None before the first.
    """

    number: int
    attempt: int
    genomes: Genomes
    fitness: Fitness
    best: Improvement | None


Callback = Callable[[Generation], object]
"""Called in each generation; the run is cancelled if it returns a true value."""


def simulate(problem: ProblemFile | Problem | str | Path, *, callback: Callback | None = None, **run: Any) -> Result:
    """Run a job in this process and return its result; bit-identical to a lockstep run of processes.

    ::

        result = supernode.simulate("examples/arm-ik.toml", torus="8x8", seed=7)
        print(result.status, result.fitness, result.solution)

    Args:
        problem: a problem file from `load`, the path of one, or a problem made in Python.
        callback: called with each `Generation`. It cannot change the run, but if it returns a true value the run is
            cancelled.
        run: settings that replace those of the file's ``[run]`` table, such as ``seed=1`` or ``torus="8x8"``.

    Returns:
        The result. If the problem's code broke, its `status` is "failed" and its `message` says why.

    Raises:
        BadInput: if the problem or a setting is wrong, or if a callback is given for an asynchronous run: such a run
            has no common generation.
    """
    file = file_of(problem).with_run(**run)
    file.refuse_unreachable()
    if callback is not None and file.run.mode != "lockstep":
        raise BadInput(f"callback: expected mode lockstep, which has common generations, found {file.run.mode}")
    request = StopRequest(file.run.seconds)
    told = None if callback is None else _CallbackListener(callback, request)
    simulation = Simulation(epochs_of(file), None, told, request.reason, ignore if told is None else told.see)
    request.began = time.monotonic()  # the deadline's time begins here: making the simulation may have compiled code
    return simulation.run()


class Listener:
    """Receives the events of a simulation; this base class ignores them."""

    def begins(self, epoch: Epoch) -> None:
        """Called when an epoch begins."""

    def improvement(self, epoch: Epoch, better: Improvement) -> None:
        """Called when a better champion was verified."""

    def lived(self, epoch: Epoch, records: Sequence[ImprovementRecord]) -> None:
        """Called with the improvements of an epoch that has ended; before `ends`, if that is called for the epoch."""

    def ends(self, epoch: Epoch, judgement: Judgement, generation: int) -> None:
        """Called when the last epoch, or an attempt that stalled, has ended after ``generation``."""


class _CallbackListener(Listener):
    """Passes each generation to the callback of `simulate`."""

    def __init__(self, callback: Callback, request: StopRequest) -> None:
        self._callback, self._request = callback, request
        self._best: Improvement | None = None
        self._since = self._attempt = 0

    def begins(self, epoch: Epoch) -> None:
        self._since, self._attempt = epoch.since, epoch.file.attempt

    def improvement(self, epoch: Epoch, better: Improvement) -> None:
        if self._best is None or better.fitness < self._best.fitness:
            self._best = better

    def see(self, generation: int, genomes: Genomes, fitness: Fitness) -> None:
        """Pass on a generation of the current epoch; a `Snapshot`."""
        number = self._since + generation
        if self._callback(Generation(number, self._attempt, genomes.copy(), fitness.copy(), self._best)):
            self._request.cancelled = True


class Simulation:
    """One simulated run, or the repetition of a recorded one.

    Only one thread may use it. It may start a process, which asks the problem's oracle; `run` ends that process.

    Args:
        epochs: the first epoch of a new run; or all epochs of a run that is to be repeated.
        stops: the stops from outside that ended the last epoch of the recorded run; None for a new run, which may
            restart by itself.
        listener: receives the events of the run.
        outside: called in each generation; returns why the run should stop, or None.
        snapshot: called with each generation of each attempt; in lockstep only.

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
        """Run to the end and return the result."""
        try:
            return self._run()
        finally:
            self._oracle.close()

    def _run(self) -> Result:
        began, past = time.monotonic(), Past()
        best: Improvement | None = None
        demes: Genomes | None = None
        while True:
            # `_known` holds the epochs still to come: all of a recorded run, or the one that `_goes_on` has appended.
            epoch = self._known.popleft()
            attempt = _Attempt(epoch, best, self._listener)
            if not self._repeats and _can_be_asked(epoch.file):
                self._oracle.turn_to(epoch.file)  # not in a repetition: it must end where the recorded run did
            demes = attempt.live(demes, self._why_to_stop, self._snapshot)
            if epoch is self._last:
                attempt.stop_as(self._stops)
            if attempt.error is None:
                self._listener.lived(epoch, records_of(past, attempt.lived))
            if attempt.error is None and self._known and not self._known[0].is_fresh:
                # An update, a rewiring or a replacement follows, so the run is not judged now. `past` keeps what the
                # cells knew.
                best = attempt.collector.best
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
        """Return whether another epoch follows; append it to `_known` if this is a new run."""
        if self._repeats:
            return bool(self._known)
        if judgement.next_attempt is None or self._oracle.is_hopeless:
            return False
        if judgement.has_oracle:
            self._oracle.ask()
        self._known.append(attempt.epoch.retried(stopped_after(attempt.reports), judgement.next_attempt))
        return True

    def _why_to_stop(self) -> Reason | None:
        """Return the reason to stop, if somebody outside wants it or the oracle has found that there is no solution."""
        reason = self._outside()
        if reason is None:
            self._oracle.look()
        return "infeasible" if reason is None and self._oracle.is_hopeless else reason

    def _with_the_oracle(self, judgement: Judgement) -> Judgement:
        """Return ``judgement`` with the oracle's answer, if the run has stalled for good or ended as hopeless.

        This waits for the oracle, which has a limit of time, unless somebody outside wants the run to stop.
        """
        if not judgement.is_open or not _can_be_asked(self.file):
            return judgement
        self._oracle.turn_to(self.file)
        self._oracle.ask()
        while (look_at := self._oracle.look_at) is not None and self._outside() is None:
            threading.Event().wait(max(0.0, look_at - time.monotonic()))
            self._oracle.look()
        bounds = self._oracle.bounds
        return judgement if bounds is None else judgement.with_oracle(bounds)

    def _load_compiled_code(self) -> None:
        """Compile or load the kernels now by one evaluation, so that the run's clock does not count it."""
        plan = self._last.plan
        with contextlib.suppress(EvaluationFailed):
            plan.evaluate(plan.coding.random(plan.keys(np.arange(1), 0), 1)[0])


def _can_be_asked(file: ProblemFile) -> bool:
    """Return whether another process can make this problem; the class of one made in Python need not be in a module."""
    return registry.is_built_in(file.kind) or not isinstance(file, InMemoryProblem)


class _Attempt:
    """One epoch of a run, with the parts of the spy and the coordinator in it."""

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
        """What `Past` needs to know of this epoch."""
        return Lived(self.epoch.file, self.reports, self.epoch.number)

    def live(self, demes: Genomes | None, outside: Outside, snapshot: Snapshot) -> Genomes | None:
        """Simulate the epoch to its end, or to where the recorded run left it; return the demes for the next epoch.

        An error of the problem's code is kept in `error`.
        """
        try:
            if self.epoch.left_at is not None:
                self.reports, demes = self.epoch.leave(demes)
            else:
                self.reports = self.epoch.live(demes, lambda _, champion: self._hear(champion), outside, snapshot)
        except EvaluationFailed as failure:
            self.error = str(failure)
        return demes

    def stop_as(self, stops: Sequence[Proposal]) -> None:
        """Add ``stops``, which came from outside, to the reports of the cells that proposed them."""
        self.reports = [
            replace(report, proposals=(*report.proposals, *(each for each in stops if each.cell == report.cell)))
            for report in self.reports
        ]

    def verified(self, past: Past) -> Judgement:
        """Judge the epoch as the spy does, and report its end to the listener."""
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
