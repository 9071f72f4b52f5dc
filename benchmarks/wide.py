"""Watch an async job on hosts far apart: how soon the spy has a champion, and what a partition does.

Usage: python -m benchmarks.wide [--torus 4x6] [--nodes 8,8,8] [--delay 50] [--loss 1] [--seconds 60]
                                 [--partitions 20] [--cut 60]

Each host is an agent in a network namespace of its own; `benchmarks.relay` delays and loses what passes between them. A
delay of 50 ms makes a round trip of 100 ms.

First a job runs for --seconds without delay and loss, then one with them: the table has the evaluations per second of
each host beside each other, and how long champions take to the client; and which share of the processors, which the
hosts have in common here, the switch between them takes. A champion's birth is dated by the counters that
its node sends: they say at which generation the node was when. Then hosts are cut off in turns, each for --cut seconds.
After each healing the table says how long it takes until every node knows a champion as good as the best on either
side, and how many messages per second the nodes send then, beside before. It needs root, or the right to make user
namespaces.
"""

from __future__ import annotations

import argparse
import bisect
import os
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path

import supernode
from benchmarks.hosts import Hosts
from benchmarks.namespaces import Namespaces, prepare
from wire import sessions
from wire.callbacks import direct
from wire.keys import Keys
from wire.news import Counters

_PROBLEM = 'kind = "function"\nname = "rastrigin"\ndimension = 300\n[run]\ntarget = -1.0\nmode = "async"\n'
_WINDOW = 10.0  # seconds over which messages are counted
_SETTLE = 15.0  # seconds until a job is at its usual pace
_JOINED_WITHIN = 300.0  # seconds after a healing
_LOOK_AGAIN = 0.1  # seconds
_JOB_SECONDS = 100_000.0


class Watcher:
    """Keeps what the nodes of one job tell, by cell, since it began."""

    def __init__(self, endpoint: str, delay: float) -> None:
        self._delay = delay
        self._lock = threading.Lock()
        self._told: dict[int, list[tuple[float, Counters]]] = defaultdict(list)
        self._session = sessions.client(endpoint)
        self._subscriber = self._session.declare_subscriber(Keys("main").any_stats, direct(self._hear))

    def _hear(self, sample: object) -> None:
        counters = Counters.decode(sample.payload.to_bytes())  # type: ignore[attr-defined]
        with self._lock:
            self._told[counters.cell].append((time.monotonic() - self._delay, counters))

    def born(self, cell: int, generation: int) -> float | None:
        """Return when a cell was in a generation, on the monotonic clock; None if that is not known."""
        with self._lock:
            told = list(self._told[cell])
        at = bisect.bisect_left(told, generation, key=lambda each: each[1].generation)
        if not 0 < at < len(told):
            return None
        (before, first), (after, second) = told[at - 1], told[at]
        share = (generation - first.generation) / max(1, second.generation - first.generation)
        return before + share * (after - before)

    def champions(self) -> dict[int, float]:
        """Return the fitness of the champion that each cell knew of last."""
        with self._lock:
            return {cell: told[-1][1].champion for cell, told in self._told.items()}

    def has_news_of(self, nodes: set[int], since: float) -> bool:
        """Return whether each of these nodes has sent counters since a time."""
        with self._lock:
            latest = {told[-1][1].node: told[-1][0] for told in self._told.values()}
        return all(latest.get(node, 0.0) > since for node in nodes)

    def evaluations_per_second(self, hosts: dict[int, str]) -> dict[str, float]:
        """Return by host the fitness calls per second of all its nodes so far; ``hosts`` has the host of each node."""
        rates: dict[str, float] = defaultdict(float)
        with self._lock:
            for told in self._told.values():
                (began, first), (ended, last) = told[0], told[-1]
                rates[hosts[first.node]] += (last.evaluations - first.evaluations) / (ended - began)
        return rates

    def messages_per_second(self, until: float) -> float:
        """Return the messages per second that all nodes sent within the window before a time.

        Counters may come late and many at once. So the two that are compared came at least a window apart.
        """
        rate = 0.0
        with self._lock:
            for told in self._told.values():
                at = bisect.bisect_right(told, until, key=lambda each: each[0])
                start = bisect.bisect_right(told, told[at - 1][0] - _WINDOW, key=lambda each: each[0])
                if at and start:
                    (began, first), (ended, last) = told[start - 1], told[at - 1]
                    rate += (last.sent - first.sent) / (ended - began)
        return rate


def watch(options: argparse.Namespace) -> None:
    """Submit the jobs and measure, on the first host; lines that begin with ``cut`` or ``heal`` are for the relay."""
    delay = options.delay / 1e3
    with supernode.connect(options.watch) as client:
        hosts = {each["node"]: each["host"] for each in client.status()["nodes"]}
        watcher, late = Watcher(options.watch, delay), []
        print("begin", flush=True)
        job = client.submit(options.problem, topology=f"torus {options.torus}", seconds=options.seconds)
        for best in job.improvements():
            late.append((time.monotonic(), best.cell, best.generation))
        rates = " | ".join(f"{rate:,.0f}" for _, rate in sorted(watcher.evaluations_per_second(hosts).items()))
        dated = [(heard, watcher.born(cell, generation)) for heard, cell, generation in late]
        ways = sorted(heard - born for heard, born in dated if born is not None) or [float("nan")]
        spread = f"{_at(ways, 0.5):.2f}, {_at(ways, 0.95):.2f}, {ways[-1]:.2f} | {len(ways)}"
        print(f"| {options.delay:g} ms, {options.loss:g} % | {rates} | {spread} |", flush=True)
        if options.partitions:
            print(
                "\n| host cut off | one champion after, s | messages/s before | after |\n|---|---:|---:|---:|",
                flush=True,
            )
            job = client.submit(options.problem, topology=f"torus {options.torus}", seconds=_JOB_SECONDS)
            _cut_in_turns(options, Watcher(options.watch, delay), hosts)
            print(f"| the job is {job.state()}, epoch {job.show()['epoch']} | | | |", flush=True)
            job.cancel()


def _at(values: list[float], share: float) -> float:
    return values[int(share * (len(values) - 1))]


def _cut_in_turns(options: argparse.Namespace, watcher: Watcher, hosts: dict[int, str]) -> None:
    names, ratios = sorted(set(hosts.values())), []
    for number in range(options.partitions):
        time.sleep(_SETTLE)
        cut, before = 1 + number % (len(names) - 1), watcher.messages_per_second(time.monotonic())
        print(f"cut {cut}", flush=True)
        time.sleep(options.cut)
        print("heal", flush=True)
        healed, theirs = time.monotonic(), {node for node, host in hosts.items() if host == names[cut]}
        best: float | None = None
        joined = False
        while not joined and time.monotonic() < healed + _JOINED_WITHIN:
            time.sleep(_LOOK_AGAIN)
            known = watcher.champions()
            if best is None and watcher.has_news_of(theirs, healed):  # only now it is known how good that side is
                best = min(known.values())
            joined = best is not None and max(known.values()) <= best
        took = time.monotonic() - healed
        time.sleep(_WINDOW)
        after = watcher.messages_per_second(time.monotonic())
        ratios.append(after / before)
        print(f"| {names[cut]} | {took if joined else float('inf'):.1f} | {before:.0f} | {after:.0f} |", flush=True)
    print(f"| messages/s after ÷ before, median and most | {statistics.median(ratios):.2f}, {max(ratios):.2f} | | |")


def _on_hosts(nodes: list[int], delay: float, loss: float, more: list[str]) -> None:
    """Start the hosts, and have the first of them watch."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Namespaces(len(nodes), (delay / 1e3, loss / 1e2)) as namespaces,
    ):
        problem = Path(folder) / "problem.toml"
        problem.write_text(_PROBLEM, encoding="utf-8")
        hosts = Hosts(namespaces, nodes, Path(folder))
        with hosts.up():
            words = ["--watch", hosts.connect, "--problem", str(problem), f"--delay={delay}", f"--loss={loss}", *more]
            command = [sys.executable, "-m", "benchmarks.wide", *words]
            with namespaces.popen(0, command, stdout=subprocess.PIPE, text=True) as watching:
                assert watching.stdout is not None
                for line in watching.stdout:
                    first, _, rest = line.partition(" ")
                    if first == "cut":
                        heal = namespaces.cut(int(rest))
                    elif first.strip() == "heal":
                        heal()
                    elif first.strip() == "begin":
                        began, used = time.monotonic(), namespaces.relay_cpu_seconds()
                    elif " ms, " in line:
                        seconds = (time.monotonic() - began) * (os.cpu_count() or 1)
                        share = (namespaces.relay_cpu_seconds() - used) / seconds
                        print(f"{line.rstrip()} {share:.1%} |", flush=True)
                    else:
                        print(line, end="", flush=True)


def main() -> None:
    """Measure without delay and loss, then with them."""
    options = _options()
    if options.watch:
        watch(options)
        return
    prepare()
    nodes = [int(each) for each in options.nodes.split(",")]
    hosts = " | ".join(f"host{host}, evaluations/s" for host in range(len(nodes)))
    champions = "a champion's way, s: median, 95 %, longest | champions"
    print(f"| delay, loss | {hosts} | {champions} | the switch's share of the processors |")
    print("|---|" + "---:|" * (len(nodes) + 3), flush=True)
    same = [f"--torus={options.torus}", f"--nodes={options.nodes}", f"--seconds={options.seconds}"]
    _on_hosts(nodes, 0.0, 0.0, [*same, "--partitions=0"])
    cuts = [f"--partitions={options.partitions}", f"--cut={options.cut}"]
    _on_hosts(nodes, options.delay, options.loss, [*same, *cuts])


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="4x6", help="its size")
    parser.add_argument("--nodes", default="8,8,8", help="of each host")
    parser.add_argument("--delay", type=float, default=50.0, help="ms, of what a host sends to others")
    parser.add_argument("--loss", type=float, default=1.0, help="per cent of packets")
    parser.add_argument("--seconds", type=float, default=60.0, help="of the first jobs")
    parser.add_argument("--partitions", type=int, default=20)
    parser.add_argument("--cut", type=float, default=60.0, help="seconds of each partition")
    parser.add_argument("--watch", help=argparse.SUPPRESS)  # the endpoint, in the process on the first host
    parser.add_argument("--problem", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if len(options.nodes.split(",")) < 2:
        parser.error("--nodes: expected two hosts at least")
    return options


if __name__ == "__main__":
    main()
