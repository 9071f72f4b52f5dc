"""Spread a torus over hosts in network namespaces; compare it with one host, and with the simulator bit for bit.

Usage: python -m benchmarks.hosts [--torus 8x8] [--nodes 24,24,16] [--generations 2000] [--mode lockstep]
                                  [--delay MS] [--loss PERCENT] [--keys TURNS]

Each host is an agent (`supernode node`) in a network namespace of its own, with an address on a bridge between them.
Router, coordinator and spy are on the first host. With --delay and --loss, which hold for what each host sends to
others, a relay (`benchmarks.relay`) takes the bridge's place; a line without delay and loss then shows what the relay
itself costs. A delay of 50 ms makes a round trip of 100 ms. It needs root, or the right to make user namespaces.

With --keys the hosts are measured by plain TCP and by TLS with keys of `supernode keys`, in so many turns.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import supernode
from benchmarks.namespaces import Namespaces, prepare
from coordinator.cpu_time import cpu_seconds_of
from supernode.chaos.hosts import children_of
from supernode.deploy.kept_alive import supernode_command
from supernode.files.authority import Authority
from wire.jobs import RIGHTS

_PROBLEM = 'kind = "function"\nname = "rastrigin"\ndimension = 20\n[run]\ntarget = -1.0\nseed = 1\n'
_READY_WITHIN = 120.0  # seconds


class Hosts:
    """A cluster on several hosts; its processes are started by `up`.

    Args:
        namespaces: one for each host.
        nodes: how many nodes each host has.
        folder: for the secret, the store and the problem file.
        has_keys: whether all links are encrypted, and each process shows a certificate.
    """

    def __init__(self, namespaces: Namespaces, nodes: list[int], folder: Path, has_keys: bool = False) -> None:
        self._namespaces, self._nodes, self._folder, self._has_keys = namespaces, nodes, folder, has_keys
        self._protocol = "tls" if has_keys else "tcp"
        self.connect = f"{self._protocol}/{namespaces.addresses[0]}:7447"
        self._agents: list[subprocess.Popen[bytes]] = []
        if has_keys:
            self._make_keys()

    def _make_keys(self) -> None:
        authority = Authority.make(self._folder / "keys")
        for role in ("coordinator", "spy"):
            authority.add(role, role, (), 1.0, ())
        authority.add("router", "router", (), 1.0, self._namespaces.addresses[:1])
        authority.add("client", "client", RIGHTS, 1.0, ())
        for host, address in enumerate(self._namespaces.addresses):
            authority.add(f"host{host}", "node", (), 1.0, (address,))

    def _trust(self, member: str) -> tuple[str, ...]:
        """Return the options by which a process knows others, and is known by them."""
        if self._has_keys:
            return "--keys", str(self._folder / "keys" / member)
        return ("--insecure",) if member == "router" else ("--secret-file", str(self._folder / "secret"))

    @contextlib.contextmanager
    def up(self) -> Iterator[None]:
        """Start all processes, wait until all nodes have joined, and end them at last."""
        with contextlib.ExitStack() as stack:
            member = ("--connect", self.connect)
            self._start(stack, 0, "router", "--listen", self.connect, *self._trust("router"))
            state = ("--nodes", str(sum(self._nodes)), "--state", str(self._folder / "state"))
            self._start(stack, 0, "coordinator", *member, *self._trust("coordinator"), *state)
            self._start(stack, 0, "spy", *member, *self._trust("spy"))
            for host, nodes in enumerate(self._nodes):
                listen = f"{self._protocol}/{self._namespaces.addresses[host]}:7450"
                insecure = () if self._has_keys else ("--insecure",)
                options = ("--nodes", str(nodes), *insecure, "--listen", listen, "--host", f"host{host}")
                self._agents.append(self._start(stack, host, "node", *member, *self._trust(f"host{host}"), *options))
            self._wait()
            yield

    def _start(self, stack: contextlib.ExitStack, host: int, *arguments: str) -> subprocess.Popen[bytes]:
        log = stack.enter_context((self._folder / f"{arguments[0]}{host}.log").open("wb"))
        process = self._namespaces.popen(host, supernode_command(*arguments), stdout=log, stderr=log)
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
        trust = self._trust("client") if self._has_keys else ()
        command = supernode_command(*arguments, "--connect", self.connect, *trust)
        try:
            found: dict[str, Any] = json.loads(self._namespaces.run(0, command))
        except ValueError:
            return None
        return found

    def cpu_seconds(self) -> float:
        """Return the CPU time that the agents' processes have used so far."""
        processes = {str(each): each for agent in self._agents for each in processes_below(agent.pid)}
        return sum(cpu_seconds_of(processes).values())


def processes_below(process: int) -> list[int]:
    """Return a process and all below it."""
    return [process, *(each for child in children_of(process) for each in processes_below(child))]


def measured(
    options: argparse.Namespace,
    nodes: list[int],
    file: Path,
    relay: tuple[float, float] | None = None,
    has_keys: bool = False,
) -> dict[str, Any]:
    """Return the result of a run on hosts, with ``cpu``, seconds of CPU of the agents."""
    with (
        tempfile.TemporaryDirectory() as folder,
        Namespaces(len(nodes), relay) as namespaces,
    ):
        hosts = Hosts(namespaces, nodes, Path(folder), has_keys)
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
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--torus", default="8x8", help="its size")
    parser.add_argument("--nodes", default="24,24,16", help="of each host")
    parser.add_argument("--generations", type=int, default=2000)
    parser.add_argument("--mode", choices=("lockstep", "async"), default="lockstep")
    parser.add_argument("--delay", type=float, default=0.0, help="ms, of what a host sends to others")
    parser.add_argument("--loss", type=float, default=0.0, help="per cent of packets")
    parser.add_argument("--keys", type=int, default=0, metavar="TURNS", help="measure by TCP and TLS in turns")
    options = parser.parse_args()
    nodes = [int(each) for each in options.nodes.split(",")]
    prepare()
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "problem.toml"
        file.write_text(_PROBLEM, encoding="utf-8")
        print("| hosts | generations/s | CPU, µs per cell and generation | lost messages | history_sha256 |")
        print("|---|---:|---:|---:|---|")
        _show("1", measured(options, [sum(nodes)], file))
        _show(f"{len(nodes)}", measured(options, nodes, file))
        for _ in range(options.keys):
            _show(f"{len(nodes)}, TCP", measured(options, nodes, file))
            _show(f"{len(nodes)}, TLS", measured(options, nodes, file, has_keys=True))
        if options.delay or options.loss:
            _show(f"{len(nodes)}, relay", measured(options, nodes, file, (0.0, 0.0)))
            relay = options.delay / 1e3, options.loss / 1e2
            words = f"{len(nodes)}, {options.delay:g} ms, {options.loss:g} %"
            _show(words, measured(options, nodes, file, relay))
        if options.mode == "lockstep":
            plan = supernode.load(str(file)).with_run(
                topology=f"torus {options.torus}", generations=options.generations, seed=2
            )
            print(f"| simulated | | | | {str(supernode.simulate(plan).history_sha256)[:16]} |")


def _show(hosts: str, result: dict[str, Any]) -> None:
    generations, cells = result["generations"], result["nodes"]
    cost = 1e6 * result["cpu"] / (generations * cells)
    digest = (result.get("history_sha256") or "")[:16]
    lost = result["messages"]["lost"]
    print(f"| {hosts} | {generations / result['seconds']:.0f} | {cost:.1f} | {lost} | {digest} |", flush=True)


if __name__ == "__main__":
    main()
