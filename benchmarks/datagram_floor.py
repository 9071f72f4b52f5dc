"""The floor of an exchange: plain Unix datagrams in Python on the same torus, which carry nothing but the bytes.

Each process sends 72 bytes to its four neighbours and waits for their datagrams, generation by generation.
"""

import os
import socket
import tempfile
import time
from pathlib import Path

from topologies import Topology

_BYTES = 72


def measure(topology: Topology, generations: int) -> tuple[float, float]:
    """Return generations per second, and CPU microseconds per node and generation.

    CPU time is that of all processes, which are reaped before it is read.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sockets = [_bind(folder, cell) for cell in range(topology.cells)]
        before = os.times()
        began = time.monotonic()
        children = [_fork(sockets, folder, topology, cell, generations) for cell in range(topology.cells)]
        for child in children:
            os.waitpid(child, 0)
        seconds = time.monotonic() - began
        after = os.times()
        for each in sockets:
            each.close()
    cpu = after.children_user - before.children_user + after.children_system - before.children_system
    return generations / seconds, cpu / topology.cells / generations * 1e6


def _bind(folder: Path, cell: int) -> socket.socket:
    bound = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    bound.bind(str(folder / str(cell)))
    return bound


def _fork(sockets: list[socket.socket], folder: Path, topology: Topology, cell: int, generations: int) -> int:
    child = os.fork()
    if child == 0:
        try:
            _exchange(sockets[cell], [str(folder / str(other)) for other in topology.neighbours(cell)], generations)
        finally:
            os._exit(0)
    return child


def _exchange(own: socket.socket, neighbours: list[str], generations: int) -> None:
    body = bytes(_BYTES - 8)
    ahead = 0  # messages of the next generation that have already arrived
    for generation in range(generations):
        message = generation.to_bytes(8, "little") + body
        for neighbour in neighbours:
            own.sendto(message, neighbour)
        missing, ahead = len(neighbours) - ahead, 0
        while missing:
            came = int.from_bytes(own.recv(_BYTES)[:8], "little")
            if came == generation:
                missing -= 1
            else:
                ahead += 1
