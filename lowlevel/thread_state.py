"""Keep the Python state of threads that Python did not start, such as Zenoh's network thread.

CPython creates a thread state before each call from a thread that it does not know, and frees it afterwards. That maps
and unmaps 16 kB, a third of the cost of receiving a message. A state that is never released is kept until the process
ends. Only a process that does nothing else may do that: in a user's program the threads of other libraries would keep
theirs too. So it must be asked for; otherwise, and where `lowlevel.capabilities` does not allow it, nothing is kept.
"""

import ctypes
import threading

from lowlevel.capabilities import capabilities

_thread = threading.local()


class _Wanted:
    here = False


def keep_in_this_process() -> None:
    """Let `keep` do so in this process; for nodes and spies, which live on messages."""
    _Wanted.here = capabilities().c_api


def keep() -> None:
    """Keep the state of the calling thread until the process ends, if this process has asked for that."""
    # The mark is stored in the state itself, so a mark that is found proves that the state was kept.
    if _Wanted.here and not hasattr(_thread, "kept"):
        _thread.kept = True
        ctypes.pythonapi.PyGILState_Ensure()  # deliberately never released: the count of users stays above zero
