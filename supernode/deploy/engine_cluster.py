"""The part that clusters on any engine have in common: the wait for their nodes, and a client."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Any, Self

from coordinator.errors import ClusterFailed
from problems.errors import BadInput
from supernode.client.client import Client, ClientJob
from supernode.client.cluster_info import Place

READY_WITHIN = 300.0  # seconds; a new machine may compile kernels first
_LOOK_AGAIN = 0.2  # seconds
ENGINE_CLUSTER = "main"  # the cluster's name: it is the only one of its router


class EngineCluster(ABC):
    """A cluster whose processes an engine keeps alive; a context manager with the interface of `LocalCluster`.

    Attributes:
        connect: the endpoint of the router.
        nodes: how many nodes there shall be.


    Args:
        given_up: whether nobody wants the cluster any more; asked while it starts.
    """

    connect: str

    def __init__(self, given_up: Callable[[], bool]) -> None:
        self._given_up = given_up
        self.nodes = 0
        self._client: Client | None = None

    @abstractmethod
    def close(self) -> None:
        """End all processes."""

    @abstractmethod
    def is_over(self) -> bool:
        """Return whether the coordinator has ended because a client asked for it (`supernode down`)."""

    def complaint(self) -> str | None:
        """Return why the nodes will never join, if that is known; else None."""
        return None

    def wait_until_ready(self) -> None:
        """Wait until the coordinator answers and all nodes have joined.

        Raises:
            ClusterFailed: if they have not in time, or never will.
        """
        until = time.monotonic() + READY_WITHIN
        while not self._is_ready():
            if (why := self.complaint()) is not None:
                raise ClusterFailed(why)
            self.refuse_given_up()
            if time.monotonic() >= until:
                raise ClusterFailed(f"{self.nodes} nodes have not joined within {READY_WITHIN:.0f} s; see the logs")
            time.sleep(_LOOK_AGAIN)

    def refuse_given_up(self) -> None:
        """Raise `ClusterFailed` if nobody wants the cluster any more."""
        if self._given_up():
            raise ClusterFailed("the cluster was asked to end before its nodes had joined")

    def _is_ready(self) -> bool:
        try:
            if self._client is None:
                self._client = Client(Place.at(self.connect))
            return len(self._client.status()["nodes"]) >= self.nodes
        except ClusterFailed:  # the router or the coordinator is not there yet
            return False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def client(self) -> Client:
        """A client of the cluster."""
        assert self._client is not None, "made while the cluster became ready"
        return self._client

    def submit(self, file: Any, **run: Any) -> ClientJob:
        """Submit a job; see `Client.submit`."""
        return self.client.submit(file, **run)

    def status(self) -> dict[str, Any]:
        """Return the state of the cluster; see `Client.status`."""
        return self.client.status()

    def _close_client(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None


def trust(modules: Sequence[str]) -> Sequence[str]:
    """Return the options by which a process may run users' modules."""
    return ("--allow-module", " ".join(modules)) if modules else ()


def shares(nodes: int, hosts: int) -> Sequence[int]:
    """Return how many nodes each host gets.

    Raises:
        BadInput: if there is not one for each.
    """
    if not 1 <= hosts <= nodes:
        raise BadInput(f"nodes: expected at least one for each of {hosts} hosts, found {nodes}")
    return [nodes // hosts + (host < nodes % hosts) for host in range(hosts)]
