"""Spread a torus over hosts in network namespaces; compare it with one host, and with the simulator bit for bit.

Usage: python -m benchmarks.hosts [--torus 8x8] [--nodes 24,24,16] [--generations 2000] [--mode lockstep]
                                  [--delay MS] [--loss PERCENT]

Each host is an agent (`supernode node`) in a network namespace of its own, with an address on a bridge between them.
Router, coordinator and spy are on the first host. With --delay and --loss, which hold for what each host sends to
others, a relay (`benchmarks.relay`) takes the bridge's place; a line without delay and loss then shows what the relay
itself costs. A delay of 50 ms makes a round trip of 100 ms. It needs root, and the program ip (Debian: iproute2).
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import supernode
from benchmarks.namespaces import Namespaces
from coordinator.cpu_time import cpu_seconds_of

_PROBLEM = 'kind = "function"\nname = "rastrigin"\ndimension = 20\n[run]\ntarget = -1.0\nseed = 1\n'
_READY_WITHIN = 120.0  # seconds


class Hosts:
    """A cluster on several hosts; its processes are started by `up`.

    Args:
        namespaces: one for each host.
        nodes: how many nodes each host has.
        folder: for the secret, the store and the problem file.
    """

    def __init__(self, namespaces: Namespaces, nodes: list[int], folder: Path) -> None:
        self._namespaces, self._nodes, self._folder = namespaces, nodes, folder
        self.connect = f"tcp/{namespaces.addresses[0]}:7447"
        self._agents: list[subprocess.Popen[bytes]] = []

    @contextlib.contextmanager
    def up(self) -> Iterator[None]:
        """Start all processes, wait until all nodes have joined, and end them at last."""
        with contextlib.ExitStack() as stack:
            member = ("--connect", self.connect, "--secret-file", str(self._folder / "secret"))
            self._start(stack, 0, "router", "--insecure", "--listen", self.connect)
            state = str(self._folder / "state")
            self._start(stack, 0, "coordinator", *member, "--nodes", str(sum(self._nodes)), "--state", state)
            self._start(stack, 0, "spy", *member)
            for host, nodes in enumerate(self._nodes):
                listen = f"tcp/{self._namespaces.addresses[host]}:7450"
                options = ("--nodes", str(nodes), "--insecure", "--listen", listen, "--host", f"host{host}")
                self._agents.append(self._start(stack, host, "node", *member, *options))
            self._wait()
            yield

    def _start(self, stack: contextlib.ExitStack, host: int, *arguments: str) -> subprocess.Popen[bytes]:
        command = self._namespaces.command(host, [sys.executable, "-m", "supernode", *arguments])
        log = stack.enter_context((self._folder / f"{arguments[0]}{host}.log").open("wb"))
        process = subprocess.Popen(command, stdout=log, stderr=log)
        stack.callback(process.wait)
        stack.callback(process.terminate)
        return process

    def _wait(self) -> None:
        until = time.monotonic() + _READY_WITHIN
        while time.monotonic() < until:
            status = self.ask("status", "--json")
            if status is not None and len(status["nodes"]) == sum(self._nodes) and status["spy"] is not None:
                return
            time.sleep(0.5)
        raise SystemExit(f"the nodes have not joined within {_READY_WITHIN:.0f} s; see the logs in {self._folder}")

    def ask(self, *arguments: str) -> dict[str, Any] | None:
        """Return what a client's command prints as JSON; None if it fails."""
        command = [sys.executable, "-m", "supernode", *arguments, "--connect", self.connect]
        ran = subprocess.run(self._namespaces.command(0, command), capture_output=True, check=False)
        try:
            found: dict[str, Any] = json.loads(ran.stdout)
        except ValueError:
            return None
        return found

    def cpu_seconds(self) -> float:
        """Return the CPU time that the agents' processes have used so far."""
        processes = {str(each): each for agent in self._agents for each in processes_below(agent.pid)}
        return sum(cpu_seconds_of(processes).values())


def processes_below(process: int) -> list[int]:
    """Return a process and all below it."""
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split()
    except OSError:
        return []
    return [process, *(each for child in children for each in processes_below(int(child)))]


def measured(
    options: argparse.Namespace, nodes: list[int], file: Path, relay: tuple[float, float] | None
) -> dict[str, Any]:
    """Return the result of a run on hosts, with ``cpu``, seconds of CPU of the agents."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Namespaces(len(nodes), relay) as namespaces,
    ):
        hosts = Hosts(namespaces, nodes, Path(folder))
        with hosts.up():
            settings = ("--torus", options.torus, "--generations", str(options.generations), "--mode", options.mode)
            hosts.ask("solve", str(file), *settings, "--json", "--quiet")  # links are made, caches filled
            before = hosts.cpu_seconds()
            job = ("solve", str(file), *settings, "--json", "--quiet", "--seed", "2")
            result = hosts.ask(*job)
            if result is None or result["status"] == "failed":
                raise SystemExit(f"the run failed: {result}")
            return result | {"cpu": hosts.cpu_seconds() - before}


def main() -> None:
    """Measure on one host and on several, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="8x8", help="its size")
    parser.add_argument("--nodes", default="24,24,16", help="of each host")
    parser.add_argument("--generations", type=int, default=2000)
    parser.add_argument("--mode", choices=("lockstep", "async"), default="lockstep")
    parser.add_argument("--delay", type=float, default=0.0, help="ms, of what a host sends to others")
    parser.add_argument("--loss", type=float, default=0.0, help="per cent of packets")
    options = parser.parse_args()
    nodes = [int(each) for each in options.nodes.split(",")]
    if os.geteuid() != 0:
        parser.error("expected root, as network namespaces need it")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.toml"
        file.write_text(_PROBLEM, encoding="utf-8")
        print("| hosts | generations/s | CPU, µs per cell and generation | lost messages | history_sha256 |")
        print("|---|---:|---:|---:|---|")
        _show("1", measured(options, [sum(nodes)], file, None))
        _show(f"{len(nodes)}", measured(options, nodes, file, None))
        if options.delay or options.loss:
            _show(f"{len(nodes)}, relay", measured(options, nodes, file, (0.0, 0.0)))
            relay = options.delay / 1e3, options.loss / 1e2
            words = f"{len(nodes)}, {options.delay:g} ms, {options.loss:g} %"
            _show(words, measured(options, nodes, file, relay))
        if options.mode == "lockstep":
            plan = supernode.load(str(file)).with_run(
                topology=f"torus {options.torus}", generations=options.generations, seed=2
            )
            print(f"| simulated | | | | {supernode.simulate(plan).history_sha256[:16]} |")


def _show(hosts: str, result: dict[str, Any]) -> None:
    generations, cells = result["generations"], result["nodes"]
    cost = 1e6 * result["cpu"] / (generations * cells)
    digest = (result.get("history_sha256") or "")[:16]
    lost = result["messages"]["lost"]
    print(f"| {hosts} | {generations / result['seconds']:.0f} | {cost:.1f} | {lost} | {digest} |", flush=True)


if __name__ == "__main__":
    main()
