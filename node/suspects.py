"""Individuals that kill the process that evaluates them, such as by a segmentation fault in a user's own code.

A node notes in a small file which individuals it evaluates; the file outlives the process. If the process crashes, the
next one suspects them all. From then on the node evaluates in a process apart (`node.evaluation_process`), so the job's
code crashes a node only once. It evaluates each suspect alone, to find the deadly one; if others kill that process
together, it suspects them, too. An individual that has killed two processes counts as infeasible and is not evaluated
again. (A node that is killed from outside by SIGKILL has not crashed.)

Problems with a compiled fitness are not watched: only a user's own code that is called from Python is suspected.
"""

import contextlib
import json
import mmap
import struct
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from node.evaluation_limits import EvaluationLimits
from node.evaluation_process import EvaluationProcess, WorkerDiedError
from problems import EvaluationFailed, Problem, ProblemFile
from problems.guard import guarded, soundly

_DEADLY = 2  # deaths after which an individual counts as infeasible
_MOST_INFEASIBLE = 1000  # of one node's; a report has to name them, and each has taken the time of three evaluations
_MOST_BATCHES = 3  # of the same individuals, if they kill a process together and none of them does so alone
_HEAD = struct.Struct("<3q64s")  # the job, how many genomes follow (0: none is evaluated), their bytes, the problem
_OTHER_CODE = -1  # in place of that number: other code of the job runs
_WHY = {"SIGALRM": "it took longer than --eval-timeout", "SIGABRT": "it took more than --node-memory, or aborted"}

Suspect = tuple[str, bytes]
"""The digest of a problem, and a genome: after an update the same genome may mean something else."""


def files_of(folder: Path, node: int) -> tuple[Path, Path]:
    """Return a node's two files: which individuals it evaluates, and whom it suspects."""
    return folder / f"node-{node}.evaluated", folder / f"node-{node}.suspects"


def runs_code(folder: Path, node: int) -> bool:
    """Return whether the node's process runs a user's own code, or did so when it died."""
    try:
        with files_of(folder, node)[0].open("rb") as file:
            _, count, _, _ = _HEAD.unpack(file.read(_HEAD.size))
    except (OSError, struct.error):
        return False
    return bool(count)


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
        tell: called when there are lines for the log (`news`), on the thread that evaluates.

    Attributes:
        deaths: how many processes each suspected genome has killed, by problem and genome.
        infeasible: those that count as infeasible.
        has_crashed: whether the job has crashed a process of this node.
    """

    def __init__(
        self, folder: Path, node: int, crash: str, limits: EvaluationLimits, tell: Callable[[], None] = lambda: None
    ) -> None:
        self._marks, self._notes = files_of(folder, node)
        self.limits = limits
        self._tell = tell
        self._room: mmap.mmap | None = None
        self._news: list[str] = []
        self._job, self.deaths, self.infeasible = self._read_notes()
        self.has_crashed = self._notes.exists()
        if crash:
            self._suspect_the_evaluated(crash)
        self._marks.unlink(missing_ok=True)

    def of(self, job: int, file: ProblemFile) -> "Watch":
        """Return what watches the evaluations of a problem; if the job is another one than before, nobody is suspected.

        Args:
            job: the job's number.
            file: the problem file.
        """
        self._turn_to(job)
        return Watch(self, file.sha256, EvaluationProcess(file, self.limits))

    def _turn_to(self, job: int) -> None:
        if job != self._job:
            self._job = job
            self._notes.unlink(missing_ok=True)
            self.has_crashed = False
            self.deaths.clear()
            self.infeasible.clear()
            self._news.clear()

    def news(self) -> list[str]:
        """Return lines for the log about individuals that count as infeasible now, each once."""
        told, self._news = self._news, []
        return told

    def mark(self, problem: str, genomes: Genomes) -> None:
        """Note that these genomes are evaluated."""
        size = _HEAD.size + genomes.nbytes
        room = self._room_of(size)
        room[_HEAD.size : size] = genomes.tobytes()
        _HEAD.pack_into(room, 0, self._job, *genomes.shape, problem.encode())  # last: with it the mark counts

    @contextlib.contextmanager
    def other_code(self, problem: str) -> Iterator[None]:
        """Note meanwhile that code of the problem runs which evaluates nothing, such as its constructor."""
        _HEAD.pack_into(self._room_of(_HEAD.size), 0, self._job, _OTHER_CODE, 0, problem.encode())
        try:
            yield
        finally:
            self.unmark()

    def _room_of(self, size: int) -> mmap.mmap:
        """Return the room for marks, so many bytes at least."""
        if self._room is None or len(self._room) < size:
            with self._marks.open("wb+") as file:
                file.truncate(size)
                self._room = mmap.mmap(file.fileno(), size)
        return self._room

    def unmark(self) -> None:
        """Note that no code of the job runs."""
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
        if count <= 0:  # no evaluation
            return
        self._turn_to(job)
        self.has_crashed = True
        places = range(_HEAD.size, _HEAD.size + count * size, max(1, size))
        self.suspect({(problem.decode(), marked[start : start + size]) for start in places}, crash)

    def suspect(self, suspects: Iterable[Suspect], crash: str) -> None:
        """Note that a process has died while it evaluated these, each given once, and how."""
        for suspect in suspects:
            self.deaths[suspect] = self.deaths.get(suspect, 0) + 1
            if self.deaths[suspect] >= _DEADLY:
                del self.deaths[suspect]
                self.infeasible.add(suspect)
                why = _WHY.get(crash, "its evaluation crashed")
                self._news.append(f"genome {suspect[1].hex()} counts as infeasible: {why} ({crash}, {_DEADLY} times)")
        self._write_notes()
        if self._news:
            self._tell()

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
        apart: evaluates the problem's individuals in another process.
    """

    def __init__(self, suspects: Suspects, problem: str, apart: EvaluationProcess) -> None:
        self._suspects = suspects
        self._problem = problem
        self._apart = apart

    def making(self) -> contextlib.AbstractContextManager[None]:
        """Return a context in which the problem is made, and its cell: that runs a user's own code, too."""
        return self._suspects.other_code(self._problem)

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

        apart = soundly(problem, self._apart.evaluate)
        return lambda genomes: (
            self._carefully(apart, genomes) if suspects.has_crashed else self._watch(evaluate, genomes)
        )

    def _watch(self, evaluate: Evaluate, genomes: Genomes) -> Fitness:
        """Evaluate genomes in this process; they are noted meanwhile."""
        self._suspects.mark(self._problem, genomes)
        try:
            return self._suspects.limits.evaluate(evaluate, genomes)
        finally:
            self._suspects.unmark()

    def _carefully(self, apart: Evaluate, genomes: Genomes) -> Fitness:
        """Evaluate genomes in a process apart, which they may kill.

        Raises:
            EvaluationFailed: if the problem's method fails, or if it cannot be found out which individuals are deadly.
        """
        self._try_suspects(genomes)
        for _ in range(_MOST_BATCHES):
            try:
                return evaluate_others(apart, genomes, self.counts_as_infeasible)
            except WorkerDiedError as death:
                crash = str(death)
            together = {genome.tobytes() for genome in genomes if not self.counts_as_infeasible(genome.tobytes())}
            self._suspects.suspect(((self._problem, genome) for genome in sorted(together)), crash)
            self._try_suspects(genomes)
            if len(self._suspects.infeasible) > _MOST_INFEASIBLE:
                raise EvaluationFailed(f"more than {_MOST_INFEASIBLE} individuals end their process, as by {crash}")
        raise EvaluationFailed(f"{len(genomes)} individuals end their process together, by {crash}, but none alone")

    def _try_suspects(self, genomes: Genomes) -> None:
        """Evaluate each suspect among the genomes alone, to find the deadly one; its fitness is not used."""
        for genome in genomes:
            suspect = self._problem, genome.tobytes()
            if suspect in self._suspects.deaths:
                try:
                    self._apart.evaluate(genome[None].copy())
                except WorkerDiedError as death:
                    self._suspects.suspect([suspect], str(death))
                else:
                    self._suspects.acquit(suspect)
