"""The process in which a problem's oracle runs: ``python -m problems.oracle_process PARENT``.

It reads a problem file as JSON from standard input and writes `OracleBounds` as JSON to standard output. An oracle may
need hours and gigabytes. The kernel therefore limits this process's processor time and memory, and kills it when the
thread that started it exits. If it is killed, the parent reads no answer, as if the problem had no oracle.
"""

import math
import os
import resource
import sys
import time

from problems import child_process

CPU_SECONDS = 1.5
"""Processor time for running the oracle; the kernel counts in whole seconds, so round up."""

_MEMORY = 1 << 30  # bytes, in addition to what the process has mapped when the limit is set
_PAGE = os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Write the answer to standard output, or nothing if the oracle has none."""
    answer = child_process.begin(int(sys.argv[1]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))  # exceeding the processor time would otherwise dump core
    os.write(answer, _answer_to(sys.stdin.read()).encode())
    os._exit(0)


def _answer_to(text: str) -> str:
    """Return the oracle's `OracleBounds` as JSON; an empty text if there is no oracle or it fails."""
    from problems.errors import BadInput, EvaluationFailed
    from problems.file import ProblemFile
    from problems.oracle_bounds import has_oracle, solve_exactly

    try:
        file = ProblemFile.from_json(text)
        if not has_oracle(file.find_model()):
            return ""
        problem = file.problem(checked=True)  # loads kernels, which may take seconds; the parent limits the time
        _limit()
        return solve_exactly(file, problem).to_json()
    except (BadInput, EvaluationFailed, MemoryError):
        return ""


def _limit() -> None:
    """Limit processor time and memory from now on, not counting what imports and the problem's kernels have used."""
    seconds = math.ceil(time.process_time() + CPU_SECONDS)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123 - a file of the kernel's
        size = int(file.read().split()[0]) * _PAGE + _MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (size, size))


if __name__ == "__main__":
    main()
