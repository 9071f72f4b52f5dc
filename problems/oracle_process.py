"""The process in which the oracle of a problem is asked: ``python -m problems.oracle_process PARENT``.

The problem file comes as JSON on standard input; what is foretold goes to standard output, as JSON. An oracle may take
hours and gigabytes, so the kernel ends this process when it has used up its processor time, and refuses it more memory;
it also ends it with the thread that started it. Whoever asks then hears nothing, as if there were no oracle.
"""

import math
import os
import resource
import sys
import time

from problems import child_process

CPU_SECONDS = 1.5
"""For making the problem and for its oracle; rounded up to whole seconds of the process, as the kernel counts them."""

_MEMORY = 1 << 30  # bytes beyond what is loaded
_PAGE = os.sysconf("SC_PAGE_SIZE")


def main() -> None:
    """Answer, or say nothing where there is nothing to say."""
    answer = child_process.begin(int(sys.argv[1]))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.write(answer, _answered(sys.stdin.read()).encode())
    os._exit(0)


def _answered(text: str) -> str:
    from problems.errors import BadInput, EvaluationFailed
    from problems.file import ProblemFile
    from problems.foretelling import has_oracle, solve_exactly

    try:
        file = ProblemFile.from_json(text)
        if not has_oracle(file.find_model()):
            return ""
        _limit()
        return solve_exactly(file, file.problem(checked=True)).to_json()
    except (BadInput, EvaluationFailed, MemoryError):
        return ""


def _limit() -> None:
    """From now on; what has been loaded does not count."""
    seconds = math.ceil(time.process_time() + CPU_SECONDS)
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
    with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123 - a file of the kernel's
        size = int(file.read().split()[0]) * _PAGE + _MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (size, size))


if __name__ == "__main__":
    main()
