"""The jobs that wait for nodes: a queue for each client, and whose turn it is.

Clients take turns: the next job is that of the client whose latest job has started the longest ago, and of its jobs the
one with the highest priority. A client with many jobs lets those with few go first, but waits for its turn no longer
than a few seconds: who waits for one answer notices each delay, who waits for a hundred does not.
"""

import itertools
from collections.abc import Callable
from typing import NamedTuple

_CLIENTS_KEPT = 1000  # without keys anybody can make up names
_FEW = 4  # jobs that wait; a client with more lets others go first
_LONGEST = 5.0  # seconds for which it does


class Waiting(NamedTuple):
    """A job in the queue; the order of these tuples is that of one client's jobs."""

    behind: int  # the negative priority
    number: int
    cells: int
    topology: str


class ClientQueues:
    """The queues of all clients."""

    def __init__(self) -> None:
        self._queues: dict[str, list[Waiting]] = {}  # by client, sorted; none is empty
        self._turns: dict[str, int] = {}  # by client, when its latest job started; the oldest first
        self._since: dict[str, float] = {}  # by client with a queue, since when its first job waits for a turn
        self._starts = itertools.count()

    @property
    def numbers(self) -> tuple[int, ...]:
        """The jobs that wait, in the order of their turns; limits may let a later one pass."""
        in_turns = sorted(
            (len(queue) > _FEW, rank, self._turn(client), queue[0].number, waiting.number)
            for client, queue in self._queues.items()
            for rank, waiting in enumerate(queue)
        )
        return tuple(number for *_, number in in_turns)

    def waiting(self, client: str) -> int:
        """Return how many jobs of a client wait."""
        return len(self._queues.get(client, ()))

    def yields(self, client: str, now: float) -> bool:
        """Return whether a client with jobs in the queue lets others go first."""
        return len(self._queues[client]) > _FEW and now - self._since[client] < _LONGEST

    def add(self, client: str, waiting: Waiting, now: float) -> None:
        """Put a job into its client's queue, ordered by priority, then by number."""
        self._since.setdefault(client, now)
        self._queues[client] = sorted([*self._queues.get(client, ()), waiting])

    def remove(self, number: int) -> bool:
        """Take a job out of its queue; return whether it was in one."""
        for client, queue in self._queues.items():
            left = [waiting for waiting in queue if waiting.number != number]
            if len(left) < len(queue):
                self._set(client, left)
                return True
        return False

    def next(self, may_have: Callable[[str], int], now: float) -> tuple[str, Waiting] | None:
        """Return the job that starts next, with its client; None if none waits whose client may have its nodes.

        Args:
            may_have: returns how many further nodes a client may have.
            now: the time, in seconds, of a clock that never goes back.
        """
        heads = [
            (self.yields(client, now), self._turn(client), queue[0].number, client)
            for client, queue in self._queues.items()
            if queue[0].cells <= may_have(client)
        ]
        if not heads:
            return None
        *_, client = min(heads)
        return client, self._queues[client][0]

    def take(self, client: str, now: float) -> None:
        """Take the first job of a client out of its queue, since it starts: this was the client's turn."""
        self._since[client] = now
        self._set(client, self._queues[client][1:])
        self._turns.pop(client, None)  # so that it becomes the latest
        self._turns[client] = next(self._starts)
        if len(self._turns) > _CLIENTS_KEPT:
            del self._turns[next(iter(self._turns))]

    def _set(self, client: str, queue: list[Waiting]) -> None:
        if queue:
            self._queues[client] = queue
        else:
            del self._queues[client], self._since[client]

    def _turn(self, client: str) -> int:
        """Return when a client's latest job started: numbers that rise with time, -1 for never."""
        return self._turns.get(client, -1)
