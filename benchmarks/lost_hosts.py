"""Kill one of several hosts at once, again and again, and watch one job go on.

Usage: python -m benchmarks.lost_hosts [--torus 8x8] [--hosts 4] [--times 20] [--mode lockstep]

Each host is an agent (`supernode node`) with its share of the nodes; all are on this machine, beside router,
coordinator and spy. In turns all processes of a host die at once (kill -9), and its agent is started again at once, as
an engine does. The job goes on when each cell has told a generation and then a later one. At last the job is stopped,
and its result is repeated in this process.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import supernode
from benchmarks.hosts import processes_below
from coordinator.errors import ClusterFailed
from supernode.chaos.repeating import repeated
from supernode.client.client import Client, ClientJob
from supernode.deploy.addresses import free_port

_PROBLEM = Path(__file__).parents[1] / "examples" / "rastrigin.toml"
_READY_WITHIN = 120.0  # seconds
_GOES_ON_WITHIN = 120.0  # seconds
_SETTLE = 3.0  # seconds
_LOOK_AGAIN = 0.1  # seconds


class Hosts:
    """The processes of a cluster on several hosts, which are all this machine.

    Args:
        hosts: how many hosts there are.
        each: the nodes of each.
        folder: for the secret and the store.
        stack: ends the processes.
    """

    def __init__(self, hosts: int, each: int, folder: Path, stack: contextlib.ExitStack) -> None:
        self._each, self._folder, self._stack = each, folder, stack
        self.connect = f"tcp/127.0.0.1:{free_port()}"
        self._start("router", "--insecure", "--listen", self.connect)
        member = ("--connect", self.connect, "--secret-file", str(folder / "secret"))
        state = str(folder / "state")
        self._start("coordinator", *member, "--nodes", str(hosts * each), "--state", state)
        self._start("spy", *member)
        self._member = member
        self._agents = [self._agent(host) for host in range(hosts)]

    def _agent(self, host: int) -> subprocess.Popen[bytes]:
        return self._start("node", *self._member, "--nodes", str(self._each), "--host", f"host{host}")

    def _start(self, *arguments: str) -> subprocess.Popen[bytes]:
        log = self._stack.enter_context((self._folder / f"{arguments[0]}.log").open("ab"))
        process = subprocess.Popen([sys.executable, "-m", "supernode", *arguments], stdout=log, stderr=log)
        self._stack.callback(process.wait)
        self._stack.callback(process.terminate)
        return process

    def lose(self, host: int) -> None:
        """Kill all processes of a host at once, and start its agent again."""
        for process in processes_below(self._agents[host].pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        self._agents[host].wait()
        self._agents[host] = self._agent(host)


def _marks(client: Client, job: ClientJob) -> dict[int, tuple[int, int]]:
    """Return the epoch and the generation that each cell of the job has told last, by cell."""
    nodes = [each for each in client.status()["nodes"] if each["job"] == job.id and each["generation"] is not None]
    return {node["cell"]: (node["epoch"], node["generation"]) for node in nodes}


def _goes_on(client: Client, job: ClientJob, cells: int) -> tuple[float, int]:
    """Wait until each cell has told a generation and then a later one; return the seconds, and the job's epoch.

    Raises:
        SystemExit: if that takes too long, or the job has ended.
    """
    began, first = time.monotonic(), dict[int, tuple[int, int]]()
    while time.monotonic() < began + _GOES_ON_WITHIN and job.state() == "running":
        now = _marks(client, job)
        first = {cell: first.get(cell, mark) for cell, mark in now.items()}  # one that is replaced begins afresh
        if len(now) == cells and all(now[cell] > first[cell] for cell in now):
            return time.monotonic() - began, job.show()["epoch"]
        time.sleep(_LOOK_AGAIN)
    raise SystemExit(f"the job does not go on: it is {job.state()}")


def _client(endpoint: str, nodes: int) -> Client:
    """Return a client once all processes of the cluster are there."""
    client, until = None, time.monotonic() + _READY_WITHIN
    while time.monotonic() < until:
        with contextlib.suppress(ClusterFailed):
            client = supernode.connect(endpoint) if client is None else client
            status = client.status()
            if status["spy"] is not None and len(status["nodes"]) == nodes:
                return client
        time.sleep(_LOOK_AGAIN)
    raise SystemExit(f"the nodes have not joined within {_READY_WITHIN:.0f} s")


def main() -> None:
    """Lose hosts, and print a line for each time."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--torus", default="8x8")
    parser.add_argument("--hosts", type=int, default=4)
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--mode", choices=("lockstep", "async"), default="lockstep")
    options = parser.parse_args()
    cells = math.prod(int(number) for number in options.torus.split("x"))
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as stack:
        hosts = Hosts(options.hosts, cells // options.hosts, Path(folder), stack)
        with _client(hosts.connect, cells) as client:
            run = {"topology": f"torus {options.torus}", "mode": options.mode, "seed": 1, "target": -1.0}
            file = supernode.load(str(_PROBLEM)).with_run(**run, stall=1 << 30)
            job = client.submit(file)
            taken = []
            for turn in range(options.times):
                time.sleep(_SETTLE)
                hosts.lose(turn % options.hosts)
                seconds, epoch = _goes_on(client, job, cells)
                taken.append(seconds)
                print(
                    f"host{turn % options.hosts} lost: all cells breed after {seconds:.1f} s, epoch {epoch}", flush=True
                )
            job.cancel()
            result = job.result(60)
    print(f"{len(taken)} of {options.times} times the job went on: {statistics.median(taken):.1f} s (median)")
    if options.mode == "lockstep":
        same = repeated(file, result.directives)[0] == result.history_sha256
        print(f"a replay in one process has {'the same' if same else 'ANOTHER'} history")


if __name__ == "__main__":
    main()
