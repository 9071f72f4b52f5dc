"""Questions to a process whose one network thread also sends, while it gives long answers; and links between hosts."""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest
import zenoh
from places import until

from supernode.deploy.addresses import free_port
from wire import sessions
from wire.callbacks import direct

LONG_BYTES = 800_000  # of one answer: what three states of each of four neighbours and the messages since take
# With one queue for all answers it takes a minute, since each full queue is given up after 5 s.
ANSWERED_WITHIN = 30.0  # s
QUESTIONS = 30
RUNS_OUT_AFTER = 1.0  # s

ANSWERING = """
import queue, sys
from wire import sessions
from wire.callbacks import direct
sessions.use_runtime(sessions.NODE_RUNTIME)
session, long = sessions.client(sys.argv[1]), queue.SimpleQueue()
size = int(sys.argv[2])

def hear(query):  # on the network thread
    if query.payload.to_bytes() == b"long":
        return long.put(query)
    with query:
        query.reply(query.key_expr, b"short")

queryable = session.declare_queryable("asked", direct(hear))
print("ready", flush=True)
while True:
    with long.get() as query:
        query.reply(query.key_expr, bytes(size))
"""
ROUTING = """
import signal, sys
from wire import sessions
sessions.use_runtime(sessions.ROUTER_RUNTIME)
session = sessions.router(sys.argv[1:])
print("ready", flush=True)
signal.pause()
"""

SILENT = """
import signal, sys
from wire import sessions
session, kept = sessions.client(sys.argv[1]), []
queryable = session.declare_queryable("asked", kept.append)
print("ready", flush=True)
signal.pause()
"""
STOPPING = """
import os, signal, sys
from wire import sessions
from wire.callbacks import direct
session = sessions.client(sys.argv[1])
for _ in range(200):
    session.get("supernode/c/jobs/x/watch", direct(lambda _: None), payload=b"short", timeout=60.0)
print("ready", flush=True)
os.kill(os.getpid(), signal.SIGSTOP)
"""
JOBS = """
import signal, sys
from wire import sessions
from wire.callbacks import direct
session = sessions.answering(sys.argv[1])

def hear(query):
    with query:
        query.reply("supernode/c/jobs/x/watch", bytes(400_000 if query.payload.to_bytes() == b"short" else 20_000_000))

queryable = session.declare_queryable("supernode/c/jobs/*/*", direct(hear))
print("ready", flush=True)
signal.pause()
"""


@pytest.fixture
def start():
    """Start a script in a process of its own, and wait until it is ready; all are killed at the end."""
    processes = []

    def started(code, *arguments):
        command = [sys.executable, "-c", code, *map(str, arguments)]
        processes.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        assert processes[-1].stdout.readline() == "ready\n"

    yield started
    for process in processes:
        process.kill()
        process.communicate()


@pytest.fixture
def asking(start):
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        endpoint = sessions.unix_socket(Path(folder), "router")
        start(ROUTING, endpoint)
        start(ANSWERING, endpoint, LONG_BYTES)
        with closing(sessions.client(endpoint)) as session:
            yield session


def test_short_answers_are_given_beside_long_ones(asking):
    began, sizes = time.monotonic(), []
    for _ in range(QUESTIONS):
        long = asking.get("asked", payload=b"long", priority=sessions.LONG_ANSWER, timeout=30.0)
        shorts = [asking.get("asked", payload=b"short", timeout=30.0) for _ in range(20)]
        sizes += [len(reply.ok.payload.to_bytes()) for short in shorts for reply in short]
        sizes += [len(reply.ok.payload.to_bytes()) for reply in long]
    assert sizes == ([5] * 20 + [LONG_BYTES]) * QUESTIONS
    assert time.monotonic() - began < ANSWERED_WITHIN


def test_clients_that_do_not_read_hold_up_nobody(start, tmp_path):
    """Each of the six would for 5 s, until Zenoh gives it up, if the router waited for room for its answers."""
    local, abroad = sessions.unix_socket(tmp_path, "router"), f"tcp/127.0.0.1:{free_port()}"
    start(ROUTING, local, abroad)
    start(JOBS, local)
    with closing(sessions.client(abroad)) as session:
        assert len(answered(session, b"short")) == 400_000
        for _ in range(6):
            start(STOPPING, abroad)
        began = time.monotonic()
        assert len(answered(session, b"short")) == 400_000
        assert time.monotonic() - began < 20.0
        assert len(answered(session, b"long")) == 20_000_000


def test_a_question_that_runs_out_while_its_asker_is_slow_holds_up_nobody(start, tmp_path):
    """The router then has to tell the asker so, while it waits for room for the answers that have come."""
    endpoint, come = sessions.unix_socket(tmp_path, "router"), []
    is_slow, is_over = threading.Event(), threading.Event()

    def hear(reply):  # on the network thread, which reads nothing meanwhile
        if not come:
            is_slow.set()
            time.sleep(2 * RUNS_OUT_AFTER)
        come.append(reply)

    for script in (ROUTING, SILENT, JOBS):
        start(script, endpoint)
    for _ in range(4):
        start(ANSWERING, endpoint, LONG_BYTES)
    with closing(sessions.client(endpoint)) as asking, closing(sessions.client(endpoint)) as another:
        everybody = {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}
        long = {"payload": b"long", "priority": sessions.LONG_ANSWER, "timeout": RUNS_OUT_AFTER}
        asking.get("asked", direct(hear, is_over.set), **everybody, **long)
        assert is_slow.wait(20.0)
        began = time.monotonic()
        assert len(answered(another, b"short")) == 400_000
        assert is_over.wait(20.0)
        assert time.monotonic() - began < 2 * RUNS_OUT_AFTER + 5.0  # it took 10 s


def answered(session, payload):
    """Return the answer, as soon as there is one; ask again if it was lost, as clients do."""
    for _ in range(3):
        for reply in session.get("supernode/c/jobs/x/watch", payload=payload, timeout=10.0):
            if reply.ok is not None:
                return reply.ok.payload.to_bytes()
    raise TimeoutError


def test_little_waits_to_be_sent_on_a_link_between_hosts():
    """On a slow link news would wait behind megabytes of what is no news any more."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with closing(sessions.peer([endpoint], [])) as one, closing(sessions.peer([], [endpoint])) as other:
        until(lambda: one.info.peers_zid() == [other.info.zid()])
        assert send_buffers(int(endpoint.rpartition(":")[2])) == [2 * 32768] * 2, "Linux doubles it"


def send_buffers(port):
    """The size of the send buffer of each end of this process's links at a port."""
    found = []
    sockets = [link.name for link in Path("/proc/self/fd").iterdir() if link.is_socket()]
    for name in sockets:
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(int(name))) as end:
            if port in (end.getsockname()[1], end.getpeername()[1]):
                found.append(end.getsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF))
    return found
