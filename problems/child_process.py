"""Start-up code of child processes that compute one answer for their parent; see `begin`."""

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1


def begin(parent: int) -> int:
    """Prepare this process to write one answer, and return the file descriptor to write it to.

    The kernel will kill this process when the thread that started it exits. Standard output is redirected to standard
    error, so that nothing that a user's module prints is taken for the answer.

    Args:
        parent: the id of the process that started this one. If it has exited already, this process exits, too.
    """
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    # The parent may have exited before prctl took effect, and then no signal would ever come.
    if os.getppid() != parent:
        os._exit(1)
    answer = os.dup(1)
    os.dup2(2, 1)
    return answer
