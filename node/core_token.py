"""A token for each core: the node that has it breeds for some generations, then hands it to the longest waiting one.

Asynchronous nodes wait for nobody, so many of them on one core all want it all the time. The kernel gives each of them
about a millisecond, whatever time slice it has asked for: as soon as another thread wakes up, a thread that has had
more than its share is preempted. With a hundred nodes on a core, each then finds its caches cold in every generation.

The token is a datagram in a socket that all nodes of a host have inherited. A node that waits for it sleeps in the
kernel's queue, which serves the longest waiting one first. A node may be killed while it has the token, so a node that
has waited far too long makes another one. Tokens are numbered: a token older than one that a node has seen is dropped
when it turns up again. At worst some nodes breed side by side for a while.
"""

import os
import socket
import struct
import time
from collections.abc import Mapping

from node.cpu_affinity import CORES, LONG, share_cores

# How many tokens were lost before, and the process that made this one. Tokens are ordered by both, so that of two made
# at the same time one is the newer.
_TOKEN = struct.Struct("qq")
_AFTERWARDS = 5e-3  # s that a node waits after it has handed the token on, so that the next node wakes up and takes it
# A node believes that its token is lost after a second and this many rounds (turns of all nodes on the core), but after
# _MOST_PATIENT seconds at the latest: a job whose nodes do not halt within a minute fails.
_ROUNDS = 4
_MOST_PATIENT = 30.0


class CoreToken:
    """The token of one core. Make it in the zygote, so that all nodes inherit its sockets.

    The socket exists until all processes that inherited it have exited. `_newest` belongs to each process alone.

    Args:
        patience: seconds that a node waits at most before it makes another token.
    """

    def __init__(self, patience: float) -> None:
        self._given, self._taken = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        # The kernel's timeout. Python's `settimeout` would make the open file description, which all nodes share,
        # non-blocking: a node would no longer sleep in the kernel's queue, but get an error at once.
        self._taken.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, _timeval(patience))
        self._newest = (0, 0)
        self._given.send(_TOKEN.pack(*self._newest))

    def take(self) -> bool:
        """Wait for the token and keep it; return False if it seems lost and this node has made another one."""
        token = (-1, 0)
        while token < self._newest:  # drops tokens that were believed lost and only came late
            try:
                token = _TOKEN.unpack(self._taken.recv(_TOKEN.size))
            except BlockingIOError:  # the socket's timeout has passed
                self._newest = (self._newest[0] + 1, os.getpid())
                return False
        self._newest = token
        return True

    def hand_on(self) -> None:
        """Hand the token to the node that has waited longest, and sleep so long that it can wake up and take it.

        Without the sleep this node could ask again, and get the token back, before the other one runs.
        """
        self._given.send(_TOKEN.pack(*self._newest))
        time.sleep(_AFTERWARDS)


CoreTokens = Mapping[int, CoreToken]
"""The tokens of cores, by the core's number."""


def for_all_cores(nodes: int) -> CoreTokens:
    """Make a token for each core if a host has so many nodes that they share cores; otherwise none."""
    patience = min(1.0 + _ROUNDS * LONG * nodes / len(CORES), _MOST_PATIENT)
    return {core: CoreToken(patience) for core in CORES if share_cores(nodes)}


def _timeval(seconds: float) -> bytes:
    """Return C's struct timeval."""
    whole, rest = divmod(seconds, 1.0)
    return struct.pack("ll", int(whole), int(rest * 1e6))
