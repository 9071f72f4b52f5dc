"""The signals that ask a command to end."""

import os
import queue
import signal
import threading

import pytest
from live_service import until

from supernode.signals import on_ending_signals


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_action_is_called_whichever_thread_takes_the_signal(kind):
    before, came, done = signal.getsignal(kind), queue.SimpleQueue(), threading.Event()
    other = threading.Thread(target=done.wait)
    other.start()
    try:
        with on_ending_signals(lambda: came.put("asked")):
            os.kill(os.getpid(), kind)
            until(lambda: came.qsize() == 1)
            signal.pthread_kill(other.ident, kind)
            until(lambda: came.qsize() == 2)
    finally:
        done.set()
        other.join()
    assert signal.getsignal(kind) == before
