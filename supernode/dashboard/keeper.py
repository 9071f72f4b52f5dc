"""Keep the dashboard's process running beside `supernode up` or `supernode solve`.

Those processes open the socket and let the dashboard inherit it, so that the address stays while a process that died is
replaced. The pipe to the dashboard's standard input is its lifeline: it exits when they do, however they end.
"""

import contextlib
import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import asdict

from coordinator.threads import ONE_THREAD
from supernode.dashboard.listen_address import ListenAddress

_AGAIN = 0.5  # seconds between two looks at the process, and the shortest pause before it is replaced
_LONGEST_PAUSE = 60.0  # seconds, the longest pause before a process that keeps dying is replaced
_LONG_LIFE = 30.0  # seconds that a process must have run for the next pause to be short again
_END_WITHIN = 5.0  # seconds until a process that does not exit is killed


class Keeper:
    """Runs the dashboard of one cluster, from `start` until `close`.

    A thread watches the process and replaces it when it has died.

    Args:
        listen_address: where the dashboard listens.
        single: whether the cluster has one run and ends with it.

    Raises:
        BadInput: if the dashboard cannot listen there.

    Attributes:
        address: the dashboard's address for people.
    """

    def __init__(self, listen_address: ListenAddress, single: bool) -> None:
        self._listen_address = listen_address
        self._single = single
        self._endpoint = ""
        self._socket = listen_address.listen()
        self.address = listen_address.address(self._socket)
        self._ending = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._keep, name="dashboard keeper", daemon=True)

    def start(self, endpoint: str) -> None:
        """Start the dashboard for the cluster whose router is at ``endpoint``."""
        self._endpoint = endpoint
        self._process = self._start()
        self._thread.start()

    def close(self) -> None:
        """End the dashboard. May be called more than once."""
        self._ending.set()
        if self._thread.is_alive():
            self._thread.join()
        self._socket.close()

    def _start(self) -> "subprocess.Popen[bytes]":
        number = self._socket.fileno()
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "supernode.dashboard"],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            env=os.environ | ONE_THREAD,
            pass_fds=[number],
            start_new_session=True,  # Ctrl-C is for the caller, which then ends this process
        )
        config = {
            "endpoint": self._endpoint,
            "listen_address": asdict(self._listen_address),
            "socket": number,
            "single": self._single,
        }
        assert process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has died already; the thread will replace it
            # Not as arguments, which all users can read: the configuration holds the token.
            process.stdin.write(json.dumps(config).encode() + b"\n")
            process.stdin.flush()
        return process

    def _keep(self) -> None:
        assert self._process is not None, "start comes first"
        began, pause = time.monotonic(), _AGAIN
        while not self._ending.wait(_AGAIN):
            status = self._process.poll()
            if status is None:
                continue
            _end(self._process)
            pause = _AGAIN if time.monotonic() - began > _LONG_LIFE else min(2 * pause, _LONGEST_PAUSE)
            sys.stderr.write(f"warning: the dashboard died (exit status {status}); another starts in {pause:g} s\n")
            if self._ending.wait(pause):
                break
            self._process, began = self._start(), time.monotonic()
        _end(self._process)


def _end(process: "subprocess.Popen[bytes]") -> None:
    assert process.stdin is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.close()
    try:
        process.wait(_END_WITHIN)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
