"""The sandbox: processes that run users' own modules have no network.

A process enters it right after the fork, before it has a second thread. It reaches the cluster by Unix sockets, which
are files. Its files, and other Unix sockets, are those of its user.
"""

from collections.abc import Collection, Mapping
from typing import Any

from coordinator.errors import ClusterFailed
from lowlevel import namespaces

_MEMORY = 2 << 30
HOST_KINDS = ("node",)
"""The kinds of processes of a host that joins a cluster: its agent runs no user's code."""


def node_memory(asked: int | None, sandbox: bool) -> int | None:
    """Return how many bytes a node may take for a user's own code: in the sandbox 2 GiB unless others are asked for."""
    return _MEMORY if asked is None and sandbox else asked


class Sandbox:
    """Lets processes enter namespaces without a network.

    Args:
        kinds: the kinds of processes that enter it, such as "node" and "spy".

    Raises:
        ClusterFailed: if there are such kinds, and this user may not make namespaces.
    """

    def __init__(self, kinds: Collection[str] = ()) -> None:
        self._kinds = kinds
        self._namespaces: namespaces.Namespaces | None = None
        if kinds:
            try:
                self._namespaces = namespaces.without_network()
            except OSError as error:
                raise ClusterFailed(
                    "--sandbox: expected a system that lets this user make user and network namespaces, found:"
                    f" {error.strerror}; allow them (see user.max_user_namespaces, and the profile of the container or"
                    " of AppArmor), or start without --sandbox"
                ) from error

    def enter(self, name: str) -> None:
        """Take the network from this process, for good, if it is of a kind that enters.

        Args:
            name: the process's name, such as "node 7".
        """
        if self._namespaces is not None and name.partition(" ")[0] in self._kinds:
            namespaces.enter(self._namespaces)


def sandbox_of(service: Mapping[str, Any] | None) -> Sandbox:
    """Return the sandbox of a launched cluster with the options ``service``, see `launcher.ServiceOptions`.

    The coordinator enters too, since it checks users' problems, unless its database may need the network.
    """
    if service is None or not service["sandbox"]:
        return Sandbox()
    return Sandbox(("node", "spy", *(() if service["database"] else ("coordinator",))))
