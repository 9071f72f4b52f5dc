"""Start-up code of child processes that compute one answer for their parent; see `begin`."""

import os

from lowlevel import linux


def begin(parent: int) -> int:
    """Prepare this process to write one answer, and return the file descriptor to write it to.

    The kernel will kill this process when the thread that started it exits. Standard output is redirected to standard
    error, so that nothing that a user's module prints is taken for the answer.

    Args:
        parent: the id of the process that started this one. If it has exited already, this process exits, too.
    """
    linux.end_with_parent(parent)
    answer = os.dup(1)
    os.dup2(2, 1)
    return answer
