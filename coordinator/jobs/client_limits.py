"""Limits for each client of a cluster: how much it may take at once, so that it leaves something to others."""

from typing import NamedTuple


class ClientLimits(NamedTuple):
    """The limits for each client; None: no limit.

    Attributes:
        waiting: how many of its jobs may wait for nodes.
        nodes: how many nodes its running jobs may have together.
    """

    waiting: int | None = None
    nodes: int | None = None


NO_LIMITS = ClientLimits()
