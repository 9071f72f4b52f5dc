"""A cluster whose processes live in several places, each started by its command, all on this machine."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import supernode
from supernode.client.client import Client
from supernode.client.cluster_info import Place

ROOT = Path(__file__).resolve().parents[2]
PATIENCE = 60.0  # seconds
DYING_WITH_THE_TEST = ("setpriv", "--pdeathsig", "KILL")


def free_port():
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        return listener.getsockname()[1]


class Places:
    """A router, a coordinator, a spy and hosts of nodes, configured by the environment; nothing yet if for no nodes."""

    def __init__(self, folder, nodes):
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.processes = {}
        self.folder = Path(folder)
        if nodes is not None:
            self.start("router", LISTEN=self.endpoint)
            self.start("coordinator", NODES=nodes, STATE=folder)
            self.start("spy")

    def start(self, name, command=None, prefix=(), **settings):
        """A process called ``name`` that runs ``command``, by default the one of that name."""
        words = {"CONNECT": self.endpoint, "SECRET_FILE": self.folder / "secret"} | settings
        variables = {f"SUPERNODE_{key}": str(value) for key, value in words.items()}
        return self.run(name, command or [name], variables, prefix)

    def run(self, name, command, variables, prefix=()):
        self.processes[name] = subprocess.Popen(
            [*prefix, *DYING_WITH_THE_TEST, sys.executable, "-m", "supernode", *command],
            env=os.environ | {"PYTHONPATH": str(ROOT)} | variables,
            cwd=self.folder,
        )
        return self.processes[name]

    def host(self, name, nodes, prefix=(), **settings):
        return self.start(name, ["node"], prefix, NODES=nodes, HOST=name, **settings)

    def client(self):
        """Once there is a coordinator that answers."""
        until = time.monotonic() + PATIENCE
        while True:
            try:
                return Client(Place.at(self.endpoint))
            except supernode.ClusterFailed:
                if time.monotonic() > until:
                    raise

    def kill(self, name, kind=signal.SIGKILL):
        process = self.processes.pop(name)
        process.send_signal(kind)
        return process.wait(PATIENCE)

    def close(self):
        for name in list(self.processes):
            self.kill(name)


@contextlib.contextmanager
def places(nodes):
    """In a folder of its own."""
    with tempfile.TemporaryDirectory() as folder, contextlib.closing(Places(folder, nodes)) as cluster:
        yield cluster


def until(happened):
    """Ask until it is true."""
    end = time.monotonic() + PATIENCE
    while not (value := happened()):
        assert time.monotonic() < end, "it has not happened"
        threading.Event().wait(0.02)
    return value
