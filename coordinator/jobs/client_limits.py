"""Limits for each client of a cluster: how much it may take at once, so that it leaves something to others."""

from typing import NamedTuple, TypeVar

_CLIENTS_KEPT = 1000  # without keys anybody can make up names
_Known = TypeVar("_Known")


class ClientLimits(NamedTuple):
    """The limits for each client; None: no limit.

    Attributes:
        waiting: how many of its jobs may wait for nodes.
        nodes: how many nodes its running jobs may have together.
    """

    waiting: int | None = None
    nodes: int | None = None


NO_LIMITS = ClientLimits()


def keep_as_the_latest(of_clients: dict[str, _Known], client: str, known: _Known) -> None:
    """Note what is known of a client, as the last entry; forget the first one if there are too many."""
    of_clients.pop(client, None)  # so that it becomes the latest
    of_clients[client] = known
    if len(of_clients) > _CLIENTS_KEPT:
        del of_clients[next(iter(of_clients))]
