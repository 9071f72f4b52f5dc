"""A job's oracle, asked beside its run: in a process of its own, which nobody waits for while cells breed.

A run that is solved within half a second never asks. The process is limited (see `problems.oracle_process`); one that
takes too long, dies or says nothing changes nothing. It dies with the thread that started it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from coordinator.threads import ONE_THREAD
from problems import BadInput, ProblemFile, registry
from problems.foretelling import Foretold, has_oracle

BEGINS_AFTER = 0.5
"""Seconds of search before the oracle is asked."""

_ENDS_AFTER = 10.0  # seconds, where the machine has too much to do for a process to use up its limit
_LOOK_AGAIN = 0.02  # seconds


class Consulting:
    """Asks a job's oracle what it knows of the problem; no call of this waits.

    Attributes:
        foretold: the answer, once there is one.
        look_at: the time at which to `look` again, by the monotonic clock; None if there is no need.
    """

    def __init__(self) -> None:
        self.foretold: Foretold | None = None
        self.look_at: float | None = None
        self._file: ProblemFile | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._ends_at = 0.0

    @property
    def is_hopeless(self) -> bool:
        """Whether the answer is there, and says that there is no way."""
        return self.foretold is not None and self.foretold.hopeless

    @property
    def process(self) -> int | None:
        """The id of the process that is being asked, if there is one."""
        return None if self._process is None else self._process.pid

    def turn_to(self, file: ProblemFile) -> None:
        """An epoch begins: from half a second on, ask about its problem, unless it is the one as before.

        What another attempt changes alters how solutions are coded, not whether there are any. Of a user's own kind
        nobody here knows whether it has an oracle: it is asked when the run has stalled, see `ask`. A job that is kept
        alive waits for another epoch, and is not told that this one is hopeless.
        """
        if self._file is not None and self._file.sha256 == file.sha256:
            return
        self.close()
        self._file, self.foretold = file, None
        if self._is_wanted and registry.is_built_in(file.kind) and _knows(file):
            self.look_at = time.monotonic() + BEGINS_AFTER

    @property
    def _is_wanted(self) -> bool:
        return self._file is not None and self._file.run.oracle and not self._file.run.keep_alive

    def ask(self) -> None:
        """Ask now, since the run has stalled, if that is not done yet; only for problems that have an oracle."""
        if self._is_wanted and self.foretold is None and self._process is None and not self._ends_at:
            self._start()

    def look(self) -> Foretold | None:
        """Start to ask if it is time, or see whether there is an answer."""
        if self.look_at is None or (now := time.monotonic()) < self.look_at:
            return self.foretold
        if self._process is None:
            self._start()
        elif self._process.poll() is not None:
            self._read(self._process)
        elif now >= self._ends_at:
            self._end()
        else:
            self.look_at = now + _LOOK_AGAIN
        return self.foretold

    def close(self) -> None:
        """End the process, if there is one, and forget what it was asked."""
        self._end()
        self._file, self._ends_at = None, 0.0

    def _start(self) -> None:
        assert self._file is not None, "an epoch has begun"
        now = time.monotonic()
        self._ends_at, self.look_at = now + _ENDS_AFTER, now + _LOOK_AGAIN
        command = [sys.executable, "-P", "-m", "problems.oracle_process", str(os.getpid())]
        with tempfile.TemporaryFile() as question:  # a pipe would fill up
            question.write(self._file.to_json().encode())
            question.seek(0)
            try:
                self._process = subprocess.Popen(
                    command,
                    stdin=question,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    env=os.environ | ONE_THREAD,
                    process_group=0,  # Ctrl-C is the caller's business
                )
            except OSError:  # no more processes: there is no answer
                self.look_at = None

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        """Read what a process has said that has ended: a line, which a pipe holds."""
        assert process.stdout is not None, "it is a pipe"
        said = process.stdout.read()
        self._end()
        try:
            self.foretold = Foretold.from_json(said.decode())
        except ValueError:
            self.foretold = None

    def _end(self) -> None:
        self.look_at = None
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            assert self._process.stdout is not None, "it is a pipe"
            self._process.stdout.close()
            self._process = None


def _knows(file: ProblemFile) -> bool:
    try:
        return has_oracle(file.find_model())
    except BadInput:
        return False
