"""Extend the model of a torus (`benchmarks.model`) to many hosts, and hold it against hosts in network namespaces.

Usage: python -m benchmarks.model_of_hosts [--torus 4x6] [--nodes 8,8,8] [--delays 0,2,10,50] [--generations 400]
                                           [--sizes 16,64,256]

Two tables, made side by side in one run:

1. Lockstep on hosts that are x ms apart (one way). The model says T = max(T0, r + x): T0 is a generation where nothing
   is late, and r a generation of two cells that wait for each other (c + w of `benchmarks.model`). Both are measured
   without delay, T0 on the hosts and r on two nodes of this machine. Each delay is then predicted and measured.
2. What starting costs: seconds until nodes are ready, seconds until a job has begun, and the router's own memory; all
   measured at some sizes, fitted by a straight line, and said for 100, 1,000 and 10,000 hosts of 100 cores; with the
   first limit that each of them meets.

It needs root, or the right to make user namespaces.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

import supernode
from benchmarks.hosts import Hosts
from benchmarks.model import error
from benchmarks.namespaces import Namespaces, prepare
from coordinator import LocalCluster
from topologies import torus_of
from wire.news import MOST_REPORTS_PER_SECOND
from wire.sessions import MOST_SESSIONS

_PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\n[run]\ntarget = -1.0\n'
_WARM_UP = 50  # generations
_SESSIONS_BESIDE_NODES = 3  # spy, coordinator, a client
_MACHINE_CORES = 100


class Start(NamedTuple):
    """The cost of a start: nodes, seconds until they were ready, seconds of an empty job, bytes of the router."""

    nodes: int
    ready: float
    job: float
    router: float


def seconds_on_hosts(torus: str, nodes: list[int], delay: float, generations: int) -> float:
    """Return the seconds of a generation in lockstep on hosts that are ``delay`` seconds apart."""
    with tempfile.TemporaryDirectory() as folder, Namespaces(len(nodes), (delay, 0.0)) as namespaces:
        problem = Path(folder) / "problem.toml"
        problem.write_text(_PROBLEM, encoding="utf-8")
        hosts = Hosts(namespaces, nodes, Path(folder))
        with hosts.up():
            taken = []
            for each in (_WARM_UP, _WARM_UP, _WARM_UP + generations):
                settings = ("--torus", torus, "--generations", str(each), "--json", "--quiet")
                result = hosts.ask("solve", str(problem), *settings)
                assert result is not None
                assert result["generations"] == each, result
                taken.append(float(result["seconds"]))
    return (taken[2] - taken[1]) / generations


def seconds_of_a_pair(generations: int) -> float:
    """Return the seconds of a generation of two nodes of this machine."""
    with LocalCluster(topology="torus 1x2") as cluster:
        taken = [
            cluster.submit(_problem().with_run(topology="torus 1x2", generations=each)).result().seconds
            for each in (_WARM_UP, _WARM_UP, _WARM_UP + generations)
        ]
    return (taken[2] - taken[1]) / generations


def start_of(nodes: int) -> Start:
    """Return what starting so many nodes on this machine, and a job on them, cost."""
    began = time.monotonic()
    with LocalCluster(topology=torus_of(nodes)) as cluster:
        ready = time.monotonic() - began
        jobs = []
        for _ in range(3):
            began = time.monotonic()
            cluster.submit(_problem().with_run(topology=torus_of(nodes), generations=1)).result()
            jobs.append(time.monotonic() - began)
        rollup = Path(f"/proc/{cluster.processes['router']}/smaps_rollup").read_text(encoding="ascii")
    (own,) = (line.split()[1] for line in rollup.splitlines() if line.startswith("Private_Dirty:"))
    return Start(nodes, ready, min(jobs), 1024.0 * int(own))


def _problem() -> supernode.ProblemFile:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "problem.toml"
        path.write_text(_PROBLEM, encoding="utf-8")
        return supernode.load(str(path))


def at(starts: list[Start], nodes: int) -> Start:
    """Return what starting so many nodes would cost: each figure is a straight line through those measured."""
    sizes = [start.nodes for start in starts]
    lines = [np.polyfit(sizes, [start[column] for start in starts], 1) for column in (1, 2, 3)]
    return Start(nodes, *(float(np.polyval(line, nodes)) for line in lines))


def first_limit(nodes: int) -> str:
    """Return in words what a torus of so many nodes meets first."""
    most = MOST_SESSIONS - _SESSIONS_BESIDE_NODES
    if nodes > most:
        return f"one router has room for {most:,} nodes"
    return f"counters of a node come every {nodes / MOST_REPORTS_PER_SECOND:.0f} s"


def main() -> None:
    """Print both tables."""
    options = _options()
    nodes = [int(each) for each in options.nodes.split(",")]
    pair, *measured = (
        seconds_of_a_pair(20 * options.generations),
        *(seconds_on_hosts(options.torus, nodes, each / 1e3, options.generations) for each in options.delays),
    )
    base = measured[0]
    print(
        f"A generation of two cells takes {pair * 1e6:.0f} µs, of {options.torus} on the hosts {base * 1e6:.0f} µs.\n"
    )
    print("| delay, ms | generations/s | model | error |\n|---:|---:|---:|---:|")
    for delay, found in zip(options.delays, measured, strict=True):
        said = max(base, pair + (delay - options.delays[0]) / 1e3)
        print(f"| {delay:g} | {1 / found:,.1f} | {1 / said:,.1f} | {error(1 / said, 1 / found):+.0f} % |")
    starts = [start_of(each) for each in options.sizes]
    print("\n| hosts | nodes | ready, s | a job begins, s | router, MB | meets first |\n|---:|---:|---:|---:|---:|---|")
    for start in starts:
        print(f"| 1 (measured) | {_figures(start)} | |")
    for hosts in (100, 1_000, 10_000):
        start = at(starts, hosts * _MACHINE_CORES)
        print(f"| {hosts:,} | {_figures(start)} | {first_limit(start.nodes)} |")


def _figures(start: Start) -> str:
    return f"{start.nodes:,} | {start.ready:,.1f} | {start.job:,.3f} | {start.router / 1e6:,.0f}"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="4x6", help="its size")
    parser.add_argument("--nodes", default="8,8,8", help="of each host")
    parser.add_argument("--delays", type=_numbers, default=[0.0, 2.0, 10.0, 50.0], help="ms, one way, the least first")
    parser.add_argument("--generations", type=int, default=400)
    parser.add_argument("--sizes", type=lambda text: [int(each) for each in text.split(",")], default=[16, 64, 256])
    options = parser.parse_args()
    prepare()
    return options


def _numbers(text: str) -> list[float]:
    return [float(each) for each in text.split(",")]


if __name__ == "__main__":
    main()
