"""Know which clients come back at once: those that submit their next job as soon as one has ended.

Their nodes are kept free for a moment, so that a job of a client with many of them does not take these first. No input,
output or clock, as the scheduler that uses it.
"""

from typing import NamedTuple

_LONGEST = (
    1.0  # seconds for which nodes are kept free, and no longer than the job took: they rest half of the time at most
)
_CLIENTS_KEPT = 1000  # without keys anybody can make up names


class _Expected(NamedTuple):
    """A client whose last job has ended: how many nodes that had, and until when its next one comes at once."""

    nodes: int
    until: float


class ReturningClients:
    """The clients that have no job waiting, and whether they come back at once.

    All times are of one clock that never goes back, in seconds.
    """

    def __init__(self) -> None:
        self._expected: dict[str, _Expected] = {}  # the oldest first
        self._prompt: set[str] = set()  # those who came at once the last time; of these nodes are kept

    def ended(self, client: str, nodes: int, seconds: float, now: float) -> None:
        """Note that a client's job has ended, which had so many nodes for so long, and that none of its jobs waits."""
        self._expected.pop(client, None)  # so that it becomes the latest
        self._expected[client] = _Expected(nodes, now + min(seconds, _LONGEST))
        if len(self._expected) > _CLIENTS_KEPT:
            self._forget(next(iter(self._expected)))

    def came(self, client: str, now: float) -> None:
        """Note that a client has submitted a job: whether it came at once decides on the next time."""
        expected = self._expected.get(client)
        if expected is None:
            return
        self._forget(client)
        if now < expected.until:
            self._prompt.add(client)

    def kept(self, now: float) -> int:
        """Return how many nodes are kept free for clients that are about to come."""
        return sum(each.nodes for each in self._awaited(now))

    def kept_until(self, now: float) -> float | None:
        """Return when fewer nodes are kept, if nobody comes; None if none are."""
        return min((each.until for each in self._awaited(now)), default=None)

    def _awaited(self, now: float) -> list[_Expected]:
        return [each for client, each in self._expected.items() if client in self._prompt and now < each.until]

    def _forget(self, client: str) -> None:
        del self._expected[client]
        self._prompt.discard(client)
