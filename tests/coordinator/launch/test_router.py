"""The router in a process of its own."""

import ctypes
import os
import signal
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
ROUTER = """
import os, signal, sys
from coordinator.launch.router import route
signal.signal(signal.SIGTERM, lambda *_: os._exit(7))
route([sys.argv[1]], int(sys.argv[2]))
"""


def test_a_signal_ends_the_router_whichever_thread_gets_it(tmp_path):
    ready, tell = os.pipe()
    command = [sys.executable, "-c", ROUTER, f"unixsock-stream/{tmp_path}/router.sock", str(tell)]
    process = subprocess.Popen(command, cwd=ROOT, pass_fds=[tell])
    try:
        os.close(tell)
        assert os.read(ready, 1) == b"!"
        threads = {int(task.name) for task in Path(f"/proc/{process.pid}/task").iterdir()}
        other = max(threads - {process.pid})  # one of Zenoh's
        assert ctypes.CDLL(None).tgkill(process.pid, other, signal.SIGTERM) == 0
        assert process.wait(20) == 7
    finally:
        os.close(ready)
        process.kill()
        process.wait()
