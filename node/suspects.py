"""Individuals that kill the process that evaluates them, such as by a segmentation fault in a user's own code.

A node notes in a small file which individuals it evaluates; the file outlives the process. If the process crashes, the
next one suspects them all, and evaluates each of them alone. An individual that has killed two processes counts as
infeasible and is not evaluated again. (A process that is killed from outside by SIGKILL has not crashed.)

Problems with a compiled fitness are not watched: only a user's own code, which is called from Python, is suspected.
"""

import json
import mmap
import os
import resource
import signal
import struct
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from problems import EvaluationFailed, Problem
from problems.guard import guarded

_DEADLY = 2  # deaths after which an individual counts as infeasible
_HEAD = struct.Struct("<3q")  # the job, how many genomes follow, and the bytes of each; 0 genomes: none is evaluated
_WHY = {"SIGALRM": "it took longer than --eval-timeout", "SIGABRT": "it took more than --node-memory, or aborted"}


def files_of(folder: Path, node: int) -> tuple[Path, Path]:
    """Return a node's two files: which individuals it evaluates, and whom it suspects."""
    return folder / f"node-{node}.evaluated", folder / f"node-{node}.suspects"


def evaluates(folder: Path, node: int) -> bool:
    """Return whether the node's process evaluates individuals, or did so when it died."""
    try:
        with files_of(folder, node)[0].open("rb") as file:
            _, count, _ = _HEAD.unpack(file.read(_HEAD.size))
    except (OSError, struct.error):
        return False
    return bool(count)


@dataclass(frozen=True)
class EvaluationLimits:
    """What an evaluation in a user's own code may take, or its process is ended.

    Attributes:
        seconds: for one individual; None for any time.
        memory: the bytes that a process may take beside what it has at its start; None for any.
    """

    seconds: float | None = None
    memory: int | None = None

    def hold(self) -> None:
        """Limit the memory of this process from now on."""
        if self.memory is not None:
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # a process that exceeds the limit aborts
            resource.setrlimit(resource.RLIMIT_DATA, (_data_bytes() + self.memory,) * 2)


def _data_bytes() -> int:
    """Return the bytes that count for RLIMIT_DATA now."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(each for each in lines if each.startswith("VmData:")).split()[1]) << 10


class Avoiding:
    """Evaluates no genome that is known to be deadly: for replays.

    Args:
        infeasible: the genomes that count as infeasible.
    """

    def __init__(self, infeasible: Collection[bytes]) -> None:
        self.infeasible = tuple(sorted(infeasible))

    def guard(self, problem: Problem) -> Evaluate:
        """Return `problems.guard.guarded` of a problem, to which the deadly are infeasible."""
        evaluate, deadly = guarded(problem), frozenset(self.infeasible)

        def avoiding(genomes: Genomes) -> Fitness:
            fitness = np.full(len(genomes), np.inf)
            harmless = np.array([genome.tobytes() not in deadly for genome in genomes], bool)
            given = genomes[harmless]
            fitness[harmless] = evaluate(given)
            genomes[harmless] = given  # a problem may change them
            return fitness

        return avoiding if deadly else evaluate


class Suspects:
    """What a node knows of deadly individuals of the job that it works on.

    Args:
        folder: the private folder of the nodes of this host.
        node: the node's number.
        crash: the signal by which the process before this one crashed; "" if it did not.
        limits: what an evaluation may take.
    """

    def __init__(self, folder: Path, node: int, crash: str, limits: EvaluationLimits) -> None:
        self._marks, self._notes = files_of(folder, node)
        self._limits = limits
        self._room: mmap.mmap | None = None
        self._news: list[str] = []
        self._job, self._deaths = self._read_notes()
        if crash:
            self._suspect_the_evaluated(crash)

    @property
    def infeasible(self) -> tuple[bytes, ...]:
        """The genomes that count as infeasible, sorted."""
        return tuple(sorted(genome for genome, deaths in self._deaths.items() if deaths >= _DEADLY))

    def of(self, job: int) -> "Suspects":
        """Return this object; if ``job`` is another one than before, nobody is suspected any more."""
        if job != self._job:
            self._job, self._deaths = job, {}
            self._news.clear()
        return self

    def news(self) -> list[str]:
        """Return lines for the log about individuals that count as infeasible now, each once."""
        told, self._news = self._news, []
        return told

    def guard(self, problem: Problem) -> Evaluate:
        """Return `problems.guard.guarded` of a problem; if its code is interpreted, it is watched."""
        evaluate = guarded(problem)
        if problem.fitness_kernel is not None:
            return evaluate

        def watched(genomes: Genomes) -> Fitness:
            if not self._deaths:
                return self._watch(evaluate, genomes)
            fitness = np.full(len(genomes), np.inf)
            deaths = np.array([self._deaths.get(genome.tobytes(), 0) for genome in genomes])
            together = [np.flatnonzero(deaths == 0)] if (deaths == 0).any() else []
            alone = np.flatnonzero((deaths > 0) & (deaths < _DEADLY))
            for numbers in (*together, *alone[:, None]):
                given = genomes[numbers]
                evaluated = {genome.tobytes() for genome in given}
                fitness[numbers] = self._watch(evaluate, given)
                genomes[numbers] = given  # a problem may change them
                self._acquit(evaluated)
            return fitness

        return watched

    def _watch(self, evaluate: Evaluate, genomes: Genomes) -> Fitness:
        """Evaluate genomes, which are noted meanwhile."""
        room = self._mark(genomes)
        if self._limits.seconds is not None:
            # The kernel ends the process, whatever loops: compiled code would hold up a handler in Python.
            signal.setitimer(signal.ITIMER_REAL, self._limits.seconds * len(genomes))
        try:
            return evaluate(genomes)
        except EvaluationFailed as error:
            if self._limits.memory is not None and isinstance(error.__cause__, MemoryError):
                os.abort()
            raise
        finally:
            if self._limits.seconds is not None:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            _HEAD.pack_into(room, 0, self._job, 0, 0)

    def _mark(self, genomes: Genomes) -> mmap.mmap:
        """Note that these genomes are evaluated; return the file's memory."""
        size = _HEAD.size + genomes.nbytes
        if self._room is None or len(self._room) < size:
            with self._marks.open("wb+") as file:
                file.truncate(size)
                self._room = mmap.mmap(file.fileno(), size)
        self._room[_HEAD.size : size] = genomes.tobytes()
        _HEAD.pack_into(self._room, 0, self._job, *genomes.shape)  # last: with it the mark counts
        return self._room

    def _acquit(self, genomes: set[bytes]) -> None:
        """Suspect these genomes no longer: they have been evaluated."""
        if not genomes.isdisjoint(self._deaths):
            self._deaths = {genome: deaths for genome, deaths in self._deaths.items() if genome not in genomes}
            self._write_notes()

    def _suspect_the_evaluated(self, crash: str) -> None:
        """Suspect what the process before this one evaluated when it crashed."""
        try:
            marked = self._marks.read_bytes()
        except FileNotFoundError:
            return
        job, count, size = _HEAD.unpack_from(marked)
        genomes = {marked[at : at + size] for at in range(_HEAD.size, _HEAD.size + count * size, max(1, size))}
        self.of(job)
        for genome in genomes:
            self._deaths[genome] = self._deaths.get(genome, 0) + 1
            if self._deaths[genome] == _DEADLY:
                why = _WHY.get(crash, "its evaluation crashed")
                self._news.append(f"genome {genome.hex()} counts as infeasible: {why} ({crash}, {_DEADLY} times)")
        self._write_notes()
        self._marks.unlink()

    def _read_notes(self) -> tuple[int, dict[bytes, int]]:
        """Return the job and the deaths that each suspected genome has caused."""
        try:
            noted = json.loads(self._notes.read_text())
        except FileNotFoundError:
            return -1, {}
        return noted["job"], {bytes.fromhex(genome): deaths for genome, deaths in noted["deaths"].items()}

    def _write_notes(self) -> None:
        """Write what `_read_notes` reads; the process may be killed meanwhile."""
        deaths = {genome.hex(): deaths for genome, deaths in self._deaths.items()}
        beside = self._notes.with_suffix(".new")
        beside.write_text(json.dumps({"job": self._job, "deaths": deaths}))
        beside.replace(self._notes)
