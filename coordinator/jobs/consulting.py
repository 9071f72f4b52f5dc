"""Ask a problem's oracle in a process of its own, beside the run of the job.

A run that is solved within half a second never asks. The process has limits of time and memory (see
`problems.oracle_process`). If it takes too long, dies or has no answer, the run is as it would be without an oracle.
The process is killed when the thread that started it ends (parent-death signal); so the conductor's thread starts it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time

from coordinator.threads import ONE_THREAD
from problems import BadInput, ProblemFile, registry
from problems.oracle_bounds import OracleBounds, has_oracle

BEGINS_AFTER = 0.5
"""Seconds of search before the oracle is asked."""

_ENDS_AFTER = 10.0  # seconds; on a busy machine the process may not use up its limit of processor time earlier
_LOOK_AGAIN = 0.02  # seconds


class Consulting:
    """Asks the oracle of one job's problem. No method blocks; only the conductor's thread uses it.

    Attributes:
        bounds: the oracle's answer; None until there is one.
        look_at: when to call `look` again, on the monotonic clock; None if there is nothing to wait for.
    """

    def __init__(self) -> None:
        self.bounds: OracleBounds | None = None
        self.look_at: float | None = None
        self._file: ProblemFile | None = None
        self._process: subprocess.Popen[bytes] | None = None
        self._ends_at = 0.0

    @property
    def is_hopeless(self) -> bool:
        """Whether the oracle has answered that the problem has no solution."""
        return self.bounds is not None and self.bounds.hopeless

    @property
    def process(self) -> int | None:
        """The id of the oracle's process; None if there is none."""
        return None if self._process is None else self._process.pid

    def turn_to(self, file: ProblemFile) -> None:
        """Begin an epoch: ask about its problem after half a second of search, unless it is the same as before.

        Another attempt changes how solutions are coded, not whether there are any, so it is the same problem here. A
        user's own kind of problem is asked only when the run has stalled (see `ask`), since it is not known here
        whether it has an oracle; so is one whose oracle rules nothing out. A job that is kept alive does not ask: an
        update may make its problem solvable.
        """
        if self._file is not None and self._file.sha256 == file.sha256:
            return
        self.close()
        self._file, self.bounds = file, None
        if self._is_wanted and registry.is_built_in(file.kind) and _may_be_ruled_out(file):
            self.look_at = time.monotonic() + BEGINS_AFTER

    @property
    def _is_wanted(self) -> bool:
        return self._file is not None and self._file.run.oracle and not self._file.run.keep_alive

    def ask(self) -> None:
        """Ask now, since the run has stalled, unless that was done already; only for problems that have an oracle."""
        if self._is_wanted and self.bounds is None and self._process is None and not self._ends_at:
            self._start()

    def look(self) -> OracleBounds | None:
        """Start the process if it is time, or look whether it has answered; return the answer if there is one."""
        if self.look_at is None or (now := time.monotonic()) < self.look_at:
            return self.bounds
        if self._process is None:
            self._start()
        elif self._process.poll() is not None:
            self._read(self._process)
        elif now >= self._ends_at:
            self._end()
        else:
            self.look_at = now + _LOOK_AGAIN
        return self.bounds

    def close(self) -> None:
        """Kill the process, if there is one, and forget the problem."""
        self._end()
        self._file, self._ends_at = None, 0.0

    def _start(self) -> None:
        assert self._file is not None, "an epoch has begun"
        now = time.monotonic()
        self._ends_at, self.look_at = now + _ENDS_AFTER, now + _LOOK_AGAIN
        command = [sys.executable, "-P", "-m", "problems.oracle_process", str(os.getpid())]
        with tempfile.TemporaryFile() as question:  # not a pipe: writing a large problem to one would block
            question.write(self._file.to_json().encode())
            question.seek(0)
            try:
                self._process = subprocess.Popen(
                    command,
                    stdin=question,
                    stdout=subprocess.PIPE,
                    stderr=subprocess.DEVNULL,
                    env=os.environ | ONE_THREAD,
                    process_group=0,  # a terminal's Ctrl-C goes to the caller's group only
                )
            except OSError:  # the system refuses another process, so there will be no answer
                self.look_at = None

    def _read(self, process: subprocess.Popen[bytes]) -> None:
        """Read the answer of a process that has ended: one line, short enough for the pipe's buffer."""
        assert process.stdout is not None, "it is a pipe"
        said = process.stdout.read()
        self._end()
        try:
            self.bounds = OracleBounds.from_json(said.decode())
        except ValueError:
            self.bounds = None

    def _end(self) -> None:
        self.look_at = None
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            assert self._process.stdout is not None, "it is a pipe"
            self._process.stdout.close()
            self._process = None


def _may_be_ruled_out(file: ProblemFile) -> bool:
    try:
        model = file.find_model()
        return has_oracle(model) and model.oracle_may_rule_out
    except BadInput:
        return False
