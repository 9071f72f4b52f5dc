"""The jobs that wait for nodes: a queue for each client, and whose turn it is.

Clients take turns: the next job is that of the client whose latest job has started the longest ago, and of its jobs the
one with the highest priority. A client with many jobs lets those with few go first: who waits for one answer after
another notices each delay. It does so for some seconds and some jobs only, and then has its turn.
"""

from collections.abc import Callable
from typing import NamedTuple

from coordinator.jobs.client_limits import keep_as_the_latest

_FEW = 4  # jobs that wait; a client with more lets others go first
# A client with many jobs has a turn when its latest job has started so long ago, or so many jobs of others have started
# since. A client with short jobs that comes back at once then waits before one in thirty of them: its latency at 95 %
# is that of a job that need not wait.
_LONGEST, _MOST_AHEAD = 5.0, 32


class Waiting(NamedTuple):
    """A job in the queue; the order of these tuples is that of one client's jobs."""

    behind: int  # the negative priority
    number: int
    cells: int
    topology: str


class _Since(NamedTuple):
    """When a client had its latest turn, or its queue began: the time, and how many jobs had started by then."""

    at: float
    starts: int


class ClientQueues:
    """The queues of all clients."""

    def __init__(self) -> None:
        self._queues: dict[str, list[Waiting]] = {}  # by client, sorted; none is empty
        self._turns: dict[str, int] = {}  # by client, when its latest job started; the oldest first
        self._waits_since: dict[str, _Since] = {}  # by client with a queue
        self._starts = 0  # of jobs, so far

    @property
    def numbers(self) -> tuple[int, ...]:
        """The jobs that wait, in the order of the clients' turns; a client that yields, or has its nodes, is passed."""
        in_turns = sorted(
            (rank, self._turn(client), queue[0].number, waiting.number)
            for client, queue in self._queues.items()
            for rank, waiting in enumerate(queue)
        )
        return tuple(number for *_, number in in_turns)

    def waiting(self, client: str) -> int:
        """Return how many jobs of a client wait."""
        return len(self._queues.get(client, ()))

    def yields(self, client: str, now: float) -> bool:
        """Return whether a client with a queue lets others go first."""
        since = self._waits_since[client]
        has_many = len(self._queues[client]) > _FEW
        return has_many and now - since.at < _LONGEST and self._starts - since.starts < _MOST_AHEAD

    def yields_until(self, now: float, besides: str) -> float | None:
        """Return when the first client, ``besides`` one, no longer lets others go first; None if no other does."""
        others = [client for client in self._queues if client != besides and self.yields(client, now)]
        return min((self._waits_since[client].at + _LONGEST for client in others), default=None)

    def add(self, client: str, waiting: Waiting, now: float) -> None:
        """Put a job into its client's queue, ordered by priority, then by number."""
        self._waits_since.setdefault(client, _Since(now, self._starts))
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
            now: the time, in seconds of a clock that never goes back.
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
        self._starts += 1
        self._waits_since[client] = _Since(now, self._starts)
        self._set(client, self._queues[client][1:])
        keep_as_the_latest(self._turns, client, self._starts)

    def _set(self, client: str, queue: list[Waiting]) -> None:
        if queue:
            self._queues[client] = queue
        else:
            del self._queues[client], self._waits_since[client]

    def _turn(self, client: str) -> int:
        """Return when a client's latest job started: numbers that rise with time, -1 for never."""
        return self._turns.get(client, -1)
