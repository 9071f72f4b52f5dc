"""Know which clients come back at once: those that submit their next job as soon as one has ended.

Their nodes are kept free for a moment, so that no job of a client with many of them takes these first. No input or
output; all times are given, in seconds of a clock that never goes back.
"""

from typing import NamedTuple

from coordinator.jobs.client_limits import keep_as_the_latest

# Seconds for which nodes are kept free: as long as the client's last job ran, within these bounds. The lower one is for
# the way to the client and back, and the check of its job, which take as long however short jobs are.
_SHORTEST, _LONGEST = 0.15, 1.0
_MOST_CELLS = 4  # for each node that is kept: a larger job would leave too many nodes idle for it


class _Client(NamedTuple):
    """A client that has had a job.

    Attributes:
        nodes: how many nodes its last job had; 0 once the client has come again.
        until: when its next job no longer comes at once.
        came_at_once: whether it did the last time.
    """

    nodes: int
    until: float
    came_at_once: bool


class ReturningClients:
    """The clients that may come back, and how many nodes are kept for those that did so at once the last time."""

    def __init__(self) -> None:
        self._clients: dict[str, _Client] = {}  # the one whose job has ended last is the last

    def ended(self, client: str, nodes: int, seconds: float, now: float) -> None:
        """Note that a client's job has ended, which had so many nodes for so long, and that none of its jobs waits."""
        known = self._clients.get(client)
        came_at_once = known is not None and known.came_at_once
        until = now + min(max(seconds, _SHORTEST), _LONGEST)
        keep_as_the_latest(self._clients, client, _Client(nodes, until, came_at_once))

    def came(self, client: str, now: float) -> None:
        """Note that a client has submitted a job: whether it came at once decides on the next time."""
        known = self._clients.get(client)
        if known is not None and known.nodes:
            self._clients[client] = _Client(0, 0.0, now < known.until)

    def kept(self, cells: int, now: float) -> int:
        """Return how many nodes are kept free from a job of so many cells (0: from any); see `_MOST_CELLS`."""
        return sum(each.nodes for each in self._awaited(cells, now))

    def kept_until(self, cells: int, now: float) -> float | None:
        """Return when fewer nodes are kept from such a job, if nobody comes; None if none are."""
        return min((each.until for each in self._awaited(cells, now)), default=None)

    def _awaited(self, cells: int, now: float) -> list[_Client]:
        prompt = [each for each in self._clients.values() if each.came_at_once and now < each.until]
        return [each for each in prompt if _MOST_CELLS * each.nodes >= cells]
