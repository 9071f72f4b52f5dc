"""On each core one node at a time breeds, for some generations, and then hands a token on to who has waited longest.

Asynchronous nodes wait for nobody, so where many of them share a core they all want it all the time. The kernel gives
each a millisecond or so, whatever turns they ask for: as soon as another thread wakes up, who has had more than his
share is interrupted. With a hundred nodes on a core each then finds its caches cold in every generation.

The token is a datagram in a socket that all nodes of a host have inherited; who waits for it sleeps in the kernel's
queue. A node may be killed while it has the token. Whoever has waited far too long makes another, and an older one than
has been seen is dropped where it turns up again: at worst some nodes breed side by side for a while.
"""

import os
import socket
import struct
import time
from collections.abc import Mapping

from node.cpu_affinity import CORES, LONG, share_cores

_TOKEN = struct.Struct("qq")  # how often one was lost before, and the process that made it
_AFTERWARDS = 5e-3  # seconds until who has handed the token on asks for it again: the next one should be awake by then
_ROUNDS = 4  # of all turns on a core, and a second, may pass until a node believes that its token was lost,
_MOST_PATIENT = 30.0  # or so many seconds: a job whose nodes do not halt within a minute fails


class CoreToken:
    """One core's. Make it in the process that the nodes are forked from: it has its end when all of them have.

    Args:
        patience: how many seconds to wait for it at most, before another is made.
    """

    def __init__(self, patience: float) -> None:
        self._given, self._taken = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        # The socket's own patience, which all nodes share; Python's would make it fail at once for all of them.
        self._taken.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(patience))
        self._newest = (0, 0)
        self._given.send(_TOKEN.pack(*self._newest))

    def take(self) -> bool:
        """Wait for it; whether there was one."""
        token = (-1, 0)
        while token < self._newest:
            try:
                token = _TOKEN.unpack(self._taken.recv(_TOKEN.size))
            except BlockingIOError:
                self._newest = (self._newest[0] + 1, os.getpid())
                return False
        self._newest = token
        return True

    def hand_on(self) -> None:
        """To who has waited longest, if he wakes up in time."""
        self._given.send(_TOKEN.pack(*self._newest))
        time.sleep(_AFTERWARDS)


CoreTokens = Mapping[int, CoreToken]
"""Those of cores, by number."""


def for_all_cores(nodes: int) -> CoreTokens:
    """One for each core that so many nodes of a host share; none if they are too few for that."""
    patience = min(1.0 + _ROUNDS * LONG * nodes / len(CORES), _MOST_PATIENT)
    return {core: CoreToken(patience) for core in CORES if share_cores(nodes)}


def _timeval(seconds: float) -> bytes:
    whole, rest = divmod(seconds, 1.0)
    return struct.pack("ll", int(whole), int(rest * 1e6))
