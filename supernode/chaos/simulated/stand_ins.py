"""Put simulated threads, clock and network in the place of the real ones, in the modules under test.

Only the names that these modules themselves have imported are replaced, for as long as a simulation runs: libraries
keep the real ones. Modules of the production code thus need no seams, but must look up such a name when they use it:
``time.monotonic()``, not a reference to the function that was taken when the module was imported.
"""

import contextlib
import importlib
import os
import pkgutil
import queue
import signal
import threading
import time
from collections.abc import Iterator
from types import ModuleType
from typing import Any

import zenoh as real_zenoh

import node.process
from node.cpu_affinity import core_of
from node.ordinary_path import OrdinaryPath
from supernode.chaos.simulated.network import Network
from supernode.chaos.simulated.thread_types import ThreadTypes
from supernode.chaos.simulated.world import Process, World
from supernode.chaos.simulated.zenoh_module import Zenoh
from wire import sessions

_PACKAGES = ("wire", "node", "spy", "coordinator.jobs", "coordinator.store", "coordinator.service")


class _System:
    """Stands in for `os`: ids, signals and descriptors are those of the simulated processes."""

    def __init__(self, world: World, processes: dict[int, Process]) -> None:
        self._world = world
        self._processes = processes

    def __getattr__(self, name: str) -> Any:
        return getattr(os, name)

    def getpid(self) -> int:
        process = self._world.process
        return 0 if process is None else process.id

    def urandom(self, count: int) -> bytes:
        return self._world.draw.randbytes(count)

    def kill(self, process: int, _: int) -> None:
        there = self._processes.get(process)
        if there is None or not there.alive:
            raise ProcessLookupError
        self._world.at(self._world.now, lambda: self._world.exited(there))

    def _exit(self, status: int) -> None:
        process = self._world.process
        assert process is not None
        process.exit(status)

    def open(self, *args: Any) -> int:
        """Open a file, and close it at the end of the simulated process, which also releases its locks."""
        descriptor = os.open(*args)
        process = self._world.process
        if process is not None:
            process.at_end.append(lambda: _close(descriptor))
        return descriptor

    def close(self, descriptor: int) -> None:
        _close(descriptor)


class _Signals:
    """Stands in for `signal`: handlers are those of the simulated processes."""

    def __init__(self, world: World) -> None:
        self._world = world

    def __getattr__(self, name: str) -> Any:
        return getattr(signal, name)

    def signal(self, number: int, handler: Any) -> None:
        process = self._world.process
        assert process is not None
        process.handlers[number] = handler


def _close(descriptor: int) -> None:
    with contextlib.suppress(OSError):
        os.close(descriptor)


def modules() -> list[ModuleType]:
    """Import and return the modules under test."""
    found = [importlib.import_module("coordinator.launch.host")]
    for name in _PACKAGES:
        package = importlib.import_module(name)
        found.append(package)
        for module in pkgutil.walk_packages(package.__path__, f"{name}."):
            if not module.name.endswith("__main__"):
                found.append(importlib.import_module(module.name))
    return found


@contextlib.contextmanager
def in_place(world: World, network: Network, processes: dict[int, Process]) -> Iterator[None]:
    """Let the modules under test use the world and the network, until the context ends."""
    types, zenoh = ThreadTypes(world), Zenoh(network)
    instead: dict[str, tuple[object, object]] = {
        "time": (time, types.time),
        "threading": (threading, types.threading),
        "queue": (queue, types.queue),
        "zenoh": (real_zenoh, zenoh.module),
        "sessions": (sessions, zenoh.sessions),
        "signal": (signal, _Signals(world)),
        "os": (os, _System(world, processes)),
        "core_of": (core_of, lambda *_: None),  # simulated nodes have no cores
        "FAST_PATH": (node.process.FAST_PATH, OrdinaryPath()),  # compiled code calls the real libraries
    }
    undo: list[tuple[ModuleType, str, object]] = []
    for module in modules():
        for name, (real, stand_in) in instead.items():
            if vars(module).get(name) is real:
                undo.append((module, name, real))
                setattr(module, name, stand_in)
    try:
        yield
    finally:
        for module, name, real in reversed(undo):
            setattr(module, name, real)
