"""Individuals that kill the process that evaluates them, such as by a segmentation fault in a user's own code.

A node notes in a small file which individuals it evaluates; the file outlives the process. If the process crashes, the
next one suspects them all, and evaluates each of them alone. An individual that has killed two processes counts as
infeasible and is not evaluated again. (A process that is killed from outside by SIGKILL has not crashed.)

Problems with a compiled fitness are not watched: only a user's own code that is called from Python is suspected.
"""

import json
import mmap
import os
import resource
import signal
import struct
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from problems import EvaluationFailed, Problem
from problems.guard import guarded

_DEADLY = 2  # deaths after which an individual counts as infeasible
_HEAD = struct.Struct("<3q64s")  # the job, how many genomes follow (0: none is evaluated), their bytes, the problem
_WHY = {"SIGALRM": "it took longer than --eval-timeout", "SIGABRT": "it took more than --node-memory, or aborted"}

Suspect = tuple[str, bytes]
"""The digest of a problem, and a genome: after an update the same genome may mean something else."""


def files_of(folder: Path, node: int) -> tuple[Path, Path]:
    """Return a node's two files: which individuals it evaluates, and whom it suspects."""
    return folder / f"node-{node}.evaluated", folder / f"node-{node}.suspects"


def evaluates(folder: Path, node: int) -> bool:
    """Return whether the node's process evaluates individuals, or did so when it died."""
    try:
        with files_of(folder, node)[0].open("rb") as file:
            _, count, _, _ = _HEAD.unpack(file.read(_HEAD.size))
    except (OSError, struct.error):
        return False
    return bool(count)


@dataclass(frozen=True)
class EvaluationLimits:
    """What an evaluation in a user's own code may take, or its process is ended.

    Attributes:
        seconds: of real time for one individual, times as many as are evaluated together; None for any time.
        memory: the bytes that a process may take beside what it has before its first job; None for any.
    """

    seconds: float | None = None
    memory: int | None = None

    def apply(self) -> None:
        """Limit this process from now on. Call it on the main thread, once the process has its sessions."""
        if self.seconds is not None:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)  # the process may have inherited that it is ignored
            signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
        if self.memory is not None:
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a process that exceeds the limit aborts
            _, hard = resource.getrlimit(resource.RLIMIT_DATA)
            most = _data_bytes() + self.memory
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(resource.RLIMIT_DATA, (most, most))


def _data_bytes() -> int:
    """Return the bytes that count for RLIMIT_DATA now."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(each for each in lines if each.startswith("VmData:")).split()[1]) << 10


class Avoiding:
    """Evaluates no genome that is known to be deadly: for replays.

    Args:
        deadly: the genomes that count as infeasible, each with the digest of its problem.
        problem: the digest of the problem that is replayed.
    """

    def __init__(self, deadly: Collection[Suspect], problem: str) -> None:
        self._deadly = frozenset(genome for whose, genome in deadly if whose == problem)
        self.infeasible = tuple(sorted(deadly))

    def counts_as_infeasible(self, genome: bytes) -> bool:
        """Return whether a genome counts as infeasible in this problem."""
        return genome in self._deadly

    def guard(self, problem: Problem) -> Evaluate:
        """Return `problems.guard.guarded` of a problem, to which the deadly are infeasible."""
        evaluate = guarded(problem)
        if not self._deadly:
            return evaluate
        return lambda genomes: evaluate_others(evaluate, genomes, self.counts_as_infeasible)


def evaluate_others(evaluate: Evaluate, genomes: Genomes, is_deadly: Callable[[bytes], bool]) -> Fitness:
    """Evaluate those that are not deadly, in one batch: the last bit of a fitness may depend on the batch."""
    fitness = np.full(len(genomes), np.inf)
    harmless = np.array([not is_deadly(genome.tobytes()) for genome in genomes], bool)
    if harmless.any():
        given = genomes[harmless]
        fitness[harmless] = evaluate(given)
        genomes[harmless] = given  # a problem may change them
    return fitness


class Suspects:
    """What a node knows of deadly individuals of the job that it works on.

    Args:
        folder: the private folder of the nodes of this host.
        node: the node's number.
        crash: the signal by which the process before this one crashed; "" if it did not.
        limits: what an evaluation may take.

    Attributes:
        deaths: how many processes each suspected genome has killed, by problem and genome.
        infeasible: those that count as infeasible.
    """

    def __init__(self, folder: Path, node: int, crash: str, limits: EvaluationLimits) -> None:
        self._marks, self._notes = files_of(folder, node)
        self.limits = limits
        self._room: mmap.mmap | None = None
        self._news: list[str] = []
        self._job, self.deaths, self.infeasible = self._read_notes()
        if crash:
            self._suspect_the_evaluated(crash)
        self._marks.unlink(missing_ok=True)

    def of(self, job: int, problem: str) -> "Watch":
        """Return what watches the evaluations of a problem; if the job is another one than before, nobody is suspected.

        Args:
            job: the job's number.
            problem: the digest of the problem, 64 characters.
        """
        if job != self._job:
            self._job = job
            self.deaths.clear()
            self.infeasible.clear()
            self._news.clear()
        return Watch(self, problem)

    def news(self) -> list[str]:
        """Return lines for the log about individuals that count as infeasible now, each once."""
        told, self._news = self._news, []
        return told

    def mark(self, problem: str, genomes: Genomes) -> None:
        """Note that these genomes are evaluated."""
        size = _HEAD.size + genomes.nbytes
        if self._room is None or len(self._room) < size:
            with self._marks.open("wb+") as file:
                file.truncate(size)
                self._room = mmap.mmap(file.fileno(), size)
        self._room[_HEAD.size : size] = genomes.tobytes()
        _HEAD.pack_into(self._room, 0, self._job, *genomes.shape, problem.encode())  # last: with it the mark counts

    def unmark(self) -> None:
        """Note that no genome is evaluated."""
        if self._room is not None:
            _HEAD.pack_into(self._room, 0, self._job, 0, 0, b"")

    def acquit(self, suspect: Suspect) -> None:
        """Suspect a genome no longer: it has been evaluated."""
        del self.deaths[suspect]
        self._write_notes()

    def _suspect_the_evaluated(self, crash: str) -> None:
        """Suspect what the process before this one evaluated when it crashed."""
        try:
            marked = self._marks.read_bytes()
        except FileNotFoundError:
            return
        job, count, size, problem = _HEAD.unpack_from(marked)
        self.of(job, problem.decode())
        places = range(_HEAD.size, _HEAD.size + count * size, max(1, size))
        for suspect in {(problem.decode(), marked[start : start + size]) for start in places}:
            self.deaths[suspect] = self.deaths.get(suspect, 0) + 1
            if self.deaths[suspect] >= _DEADLY:
                del self.deaths[suspect]
                self.infeasible.add(suspect)
                why = _WHY.get(crash, "its evaluation crashed")
                self._news.append(f"genome {suspect[1].hex()} counts as infeasible: {why} ({crash}, {_DEADLY} times)")
        self._write_notes()

    def _read_notes(self) -> tuple[int, dict[Suspect, int], set[Suspect]]:
        """Return the job, the deaths, and what counts as infeasible."""
        try:
            noted = json.loads(self._notes.read_text())
        except FileNotFoundError:
            return -1, {}, set()
        deaths = {(problem, bytes.fromhex(genome)): count for problem, genome, count in noted["deaths"]}
        return noted["job"], deaths, {(problem, bytes.fromhex(genome)) for problem, genome in noted["infeasible"]}

    def _write_notes(self) -> None:
        """Write what `_read_notes` reads; the process may be killed meanwhile."""
        deaths = [(problem, genome.hex(), count) for (problem, genome), count in self.deaths.items()]
        infeasible = [(problem, genome.hex()) for problem, genome in sorted(self.infeasible)]
        beside = self._notes.with_suffix(".new")
        beside.write_text(json.dumps({"job": self._job, "deaths": deaths, "infeasible": infeasible}))
        beside.replace(self._notes)


class Watch:
    """Watches the evaluations of one problem.

    Args:
        suspects: what the node knows.
        problem: the digest of the problem.
    """

    def __init__(self, suspects: Suspects, problem: str) -> None:
        self._suspects = suspects
        self._problem = problem

    @property
    def infeasible(self) -> tuple[Suspect, ...]:
        """The job's genomes that count as infeasible, each with the digest of its problem, sorted."""
        return tuple(sorted(self._suspects.infeasible))

    def counts_as_infeasible(self, genome: bytes) -> bool:
        """Return whether a genome counts as infeasible in this problem."""
        return (self._problem, genome) in self._suspects.infeasible

    def guard(self, problem: Problem) -> Evaluate:
        """Return `problems.guard.guarded` of a problem; if its code is interpreted, it is watched."""
        evaluate, suspects = guarded(problem), self._suspects
        if problem.fitness_kernel is not None:
            return evaluate

        def watched(genomes: Genomes) -> Fitness:
            return self._watch(evaluate, genomes)

        def careful(genomes: Genomes) -> Fitness:
            for genome in genomes:  # each suspect alone, to find the deadly one; its fitness is not used
                suspect = self._problem, genome.tobytes()
                if suspect in suspects.deaths:
                    watched(genome[None].copy())
                    suspects.acquit(suspect)
            return evaluate_others(watched, genomes, self.counts_as_infeasible)

        return lambda genomes: careful(genomes) if suspects.deaths or suspects.infeasible else watched(genomes)

    def _watch(self, evaluate: Evaluate, genomes: Genomes) -> Fitness:
        """Evaluate genomes, which are noted meanwhile."""
        limits = self._suspects.limits
        self._suspects.mark(self._problem, genomes)
        if limits.seconds is not None:
            # The kernel ends the process, whatever loops: compiled code would hold up a handler in Python.
            signal.setitimer(signal.ITIMER_REAL, limits.seconds * len(genomes))
        try:
            return evaluate(genomes)
        except EvaluationFailed as error:
            if limits.memory is not None and isinstance(error.__cause__, MemoryError):
                os.abort()
            raise
        finally:
            if limits.seconds is not None:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            self._suspects.unmark()
