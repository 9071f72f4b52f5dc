"""The number of threads that numerical libraries start in the project's processes."""

import os
import sys

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""Environment variables that limit each library to one thread: there are many processes, and threads take memory."""


def begin_again_with_one_thread() -> None:
    """Start this program again if numerical libraries may have started threads in it.

    They read their variables only once. A process of several threads may not enter a user namespace.
    """
    if not os.environ.items() >= ONE_THREAD.items():
        os.execve(sys.executable, sys.orig_argv, os.environ | ONE_THREAD)
