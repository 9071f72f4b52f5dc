"""The signals that ask a command to end."""

import os
import queue
import signal
import threading
from pathlib import Path

import pytest
from live_service import until

from supernode.signals import on_ending_signals, wait_for_an_end


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


@pytest.mark.timeout(20)
def test_a_wait_ends_though_another_thread_takes_the_signal():
    came, ready = queue.SimpleQueue(), threading.Event()
    main = threading.current_thread().native_id

    def take_the_signal():
        ready.wait()
        switches = [-2, -1]
        # A thread that waits for the interpreter wakes every 5 ms; one that waits for the queue does not.
        until(lambda: switches.append(_switches(main)) or switches[-1] == switches[-2])
        signal.pthread_kill(threading.get_ident(), signal.SIGTERM)

    other = threading.Thread(target=take_the_signal)
    other.start()
    with on_ending_signals(lambda: came.put("asked")):
        ready.set()
        assert wait_for_an_end(came) == "asked"
    other.join()


def _switches(thread):
    """How often a thread of this process has begun to wait."""
    lines = Path(f"/proc/self/task/{thread}/status").read_text().splitlines()
    return int(next(each for each in lines if each.startswith("voluntary")).split()[1])
