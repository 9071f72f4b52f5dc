"""Where no direct link is possible neighbours are heard through the router; two folders of sockets are two networks."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import pytest
import zenoh
from epochs import again

import supernode
from coordinator.jobs.dispatcher import Dispatcher
from coordinator.jobs.job import JobSpec
from wire import sessions
from wire.callbacks import direct
from wire.keys import Keys
from wire.seal import Seal

SPEC = "torus 2x2"
CLUSTER = "apart"
PROCESS = """
import ctypes, json, os, signal, sys
from pathlib import Path
ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # none outlives the test
import node.links
from coordinator.launch.imports import import_all
from node.node_config import NodeConfig
from problems.modules import AnyModules
role, folder, node_number, router = json.loads(sys.argv[1])
node.links._DIRECT_WITHIN = 0.5
configuration = NodeConfig("apart", node_number, "torus 2x2", Path(folder), router, bytes(32), AnyModules())
if role == "router":
    from coordinator.launch.router import route
    route([router], 1)
elif role == "spy":
    from spy.process import watch
    import_all()
    watch(configuration)
else:
    from node.process import live
    import_all()  # as those that fork nodes do; else each would import what it lacks while others breed
    live(configuration)
"""


def start(role, folder, number, router):
    arguments = json.dumps([role, str(folder), number, router])
    return subprocess.Popen([sys.executable, "-c", PROCESS, arguments], stdout=subprocess.PIPE)


@pytest.fixture
def apart():
    """A cluster whose upper and lower row of cells cannot reach each other; yields a session and the keys."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as upper, tempfile.TemporaryDirectory(dir="/dev/shm") as lower:
        router = sessions.unix_socket(Path(upper), "router")
        processes = [start("router", upper, 0, router)]
        assert processes[0].stdout.read(1) == b"!"
        processes.append(start("spy", upper, 0, router))
        processes += [start("node", upper if cell < 2 else lower, cell, router) for cell in range(4)]
        session, keys = sessions.client(router), Keys(CLUSTER)

        def join():
            for here, there in ((upper, lower), (lower, upper)):
                for socket in Path(here).glob("n*.sock"):
                    if not socket.is_symlink():
                        (Path(there) / socket.name).symlink_to(socket)

        try:
            wait_for(session, {keys.node(cell) for cell in range(4)} | {keys.spy})
            yield session, keys, join
        finally:
            session.close()
            for process in processes:
                os.kill(process.pid, signal.SIGKILL)
                process.wait()
                process.stdout.close()


def wait_for(session, awaited, kind=zenoh.SampleKind.PUT, meanwhile=lambda: None):
    """Wait until all tokens have come, or gone."""
    happened = threading.Event()

    def see(sample):
        if sample.kind == kind:
            awaited.discard(str(sample.key_expr))
            if not awaited:
                happened.set()

    watchers = [session.liveliness().declare_subscriber(key, direct(see), history=True) for key in tuple(awaited)]
    meanwhile()
    assert happened.wait(60), awaited
    for watcher in watchers:
        watcher.undeclare()


def test_cells_on_two_networks_hear_each_other_through_the_router_until_they_can_do_without(apart, own_problem):
    session, keys, join = apart
    file = supernode.load(own_problem("size = 64")).with_run(topology=SPEC, target=-1.0, generations=40, seed=5)
    dispatcher = Dispatcher(session, keys, Seal(bytes(32)), SPEC)

    def run(number, file):
        return dispatcher.submit(JobSpec(number, file)).result(timeout=60)

    loose = run(1, file.with_run(mode="async", generations=4000))  # so long that all run most of the time at once
    assert (loose.status, loose.generations) == ("exhausted", 4000)
    assert loose.messages["received"] > loose.messages["sent"] > 1000, "each has two neighbours"
    routed = run(2, file)
    wait_for(session, {keys.routed(cell) for cell in range(4)}, zenoh.SampleKind.DELETE, join)
    linked = run(3, file)
    for result in (routed, linked):
        assert result.messages["received"] == 2 * result.messages["sent"]
        assert result.messages["lost"] == 0
        assert result.history_sha256 == again(file, result)
