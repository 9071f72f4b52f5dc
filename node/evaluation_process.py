"""A process in which a node evaluates individuals that may kill it: ``python -m node.evaluation_process PARENT``.

A node uses one once the code of its job has crashed the node itself (`node.suspects`). The process reads the problem
file and makes the problem. Then it forks a worker, which reads genomes from standard input and writes what they came to
to standard output. When a worker dies, the process writes how, and forks another one. It has a single thread, so it may
fork, and a user's module is imported once.
"""

import json
import mmap
import os
import signal
import struct
import subprocess
import sys
import weakref
from collections.abc import Callable
from functools import partial
from typing import IO

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from lowlevel import linux
from node.evaluation_limits import EvaluationLimits
from problems import EvaluationFailed, ProblemFile, child_process
from problems.guard import evaluated

_REQUEST = struct.Struct("<2q")  # how many genomes follow, and their bytes
_ANSWER = struct.Struct("<cq")  # what follows, and its bytes
_READY = b"r"  # nothing: the problem has been made
_EVALUATED = b"e"  # fitness, then the genomes, which the problem may have changed
_FAILED = b"f"  # the message of an `EvaluationFailed`
_DIED = b"d"  # the signal's name, or "exit"
_MOST_STARTS = 3  # for one request: a process may be killed from outside, or crash between two requests


class WorkerDiedError(Exception):
    """The process that evaluated individuals has died of it; the text is the signal's name, or "exit"."""


class EvaluationProcess:
    """Evaluates the individuals of one problem in another process, which is started when it is needed.

    The process ends with this object, and with the thread that first evaluates.

    Args:
        file: the problem file.
        limits: what an evaluation may take.
    """

    def __init__(self, file: ProblemFile, limits: EvaluationLimits) -> None:
        self._file, self._limits = file, limits
        self._process: subprocess.Popen[bytes] | None = None
        self._end: Callable[[], object] | None = None

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return a number of any value for each of the genomes, which the problem may change.

        Raises:
            EvaluationFailed: as `problems.guard.evaluated` does, or if there is no process to evaluate in.
            WorkerDiedError: if it ends its process.
        """
        for _ in range(_MOST_STARTS):
            try:
                kind, answer = self._asked(_REQUEST.pack(*genomes.shape) + genomes.tobytes())
                break
            except OSError:  # the whole process has ended, by something else than these genomes
                self._drop()
        else:
            raise WorkerDiedError("SIGKILL")
        if kind == _DIED:
            raise WorkerDiedError(answer.decode())
        if kind == _FAILED:
            raise EvaluationFailed(answer.decode())
        fitness = np.frombuffer(answer, np.float64, len(genomes)).copy()
        genomes[:] = np.frombuffer(answer, np.uint8, genomes.size, fitness.nbytes).reshape(genomes.shape)
        return fitness

    def _asked(self, request: bytes) -> tuple[bytes, bytes]:
        """Send a request, and return the kind of the answer and the answer.

        Raises:
            EvaluationFailed: if there is no process to ask.
            OSError: if it has ended.
        """
        process = self._process or self._start()
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(request)
        process.stdin.flush()
        kind, size = _ANSWER.unpack(_all_of(process.stdout, _ANSWER.size))
        return kind, _all_of(process.stdout, size)

    def _start(self) -> "subprocess.Popen[bytes]":
        """Start the process, and wait until it has made the problem.

        Raises:
            EvaluationFailed: if it does not.
        """
        command = [sys.executable, "-P", "-m", "node.evaluation_process", str(os.getpid())]
        setting = json.dumps([self._file.to_json(), self._limits.seconds, self._limits.memory]).encode()
        try:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            self._process, self._end = process, weakref.finalize(self, _end, process)
            assert process.stdin is not None
            assert process.stdout is not None
            process.stdin.write(struct.pack("<q", len(setting)) + setting)
            process.stdin.flush()
            if process.stdout.read(_ANSWER.size) == _ANSWER.pack(_READY, 0):
                return process
        except OSError:
            pass
        self._drop()
        raise EvaluationFailed(f"{self._file.kind}: no process apart could be started to evaluate in")

    def _drop(self) -> None:
        if self._end is not None:
            self._end()
        self._process = self._end = None


def _all_of(pipe: IO[bytes], size: int) -> bytes:
    """Return so many bytes; raise `BrokenPipeError` if the pipe ends before."""
    found = pipe.read(size)
    if len(found) < size:
        raise BrokenPipeError
    return found


def _end(process: "subprocess.Popen[bytes]") -> None:
    process.kill()  # its worker ends with it
    process.communicate()


# In the process itself ------------------------------------------------------------------------------------------------
def main() -> None:
    """Fork workers, one after another, until the node has no more genomes."""
    answers = child_process.begin(int(sys.argv[1]))
    (size,) = struct.unpack("<q", _read(8))
    file, *limits = json.loads(_read(size))
    problem, limited = ProblemFile.from_json(file).problem(checked=True).for_cell(), EvaluationLimits(*limits)
    is_busy = mmap.mmap(-1, 1)  # shared with workers: 1 from when a request has been read until it is answered
    _write(answers, _READY, b"")
    while True:
        parent = os.getpid()
        worker = os.fork()
        if worker == 0:
            linux.end_with_parent(parent)
            _serve(partial(evaluated, problem), limited, answers, is_busy)
        _, status = os.waitpid(worker, 0)
        crash = signal.Signals(os.WTERMSIG(status)).name if os.WIFSIGNALED(status) else "exit"
        # The genomes are to blame only if they were evaluated. SIGKILL comes from outside. A worker that has died at
        # another time may have read a part of a request, so all begins anew; or there are no more requests.
        if not is_busy[0] or crash == "SIGKILL":
            os._exit(1)
        is_busy[0] = 0
        _write(answers, _DIED, crash.encode())


def _serve(evaluate: Evaluate, limits: EvaluationLimits, answers: int, is_busy: mmap.mmap) -> None:
    """Answer requests until there are no more, and exit."""
    limits.apply()
    while True:
        count, size = _REQUEST.unpack(_read(_REQUEST.size))
        genomes = np.frombuffer(bytearray(_read(count * size)), np.uint8).reshape(count, size)
        is_busy[0] = 1
        try:
            fitness = limits.evaluate(evaluate, genomes)
        except EvaluationFailed as error:
            kind, answer = _FAILED, str(error).encode()
        else:
            kind, answer = _EVALUATED, fitness.tobytes() + genomes.tobytes()
        is_busy[0] = 0
        _write(answers, kind, answer)


def _read(size: int) -> bytes:
    """Return so many bytes of standard input, unbuffered, since workers share it; exit at its end."""
    found = b""
    while len(found) < size:
        piece = os.read(0, size - len(found))
        if not piece:
            os._exit(0)
        found += piece
    return found


def _write(answers: int, kind: bytes, answer: bytes) -> None:
    left = _ANSWER.pack(kind, len(answer)) + answer
    while left:
        left = left[os.write(answers, left) :]


if __name__ == "__main__":
    main()
