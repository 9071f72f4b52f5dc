"""What a process does first that another one has started for a single answer: see `begin`."""

import os

from lowlevel import linux


def begin(parent: int) -> int:
    """Die with the thread that started this process; returns a descriptor for the answer.

    Standard output becomes standard error, so that nothing that a user's module prints is taken for the answer. Exits
    at once if the process ``parent`` has died already: then nobody would end this one.
    """
    linux.end_with_parent(parent)
    answer = os.dup(1)
    os.dup2(2, 1)
    return answer
