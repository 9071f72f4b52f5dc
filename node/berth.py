"""A node's place in a cluster: what it must be told before it can link itself."""

from dataclasses import dataclass
from pathlib import Path

from wire import sessions
from wire.keys import Keys


@dataclass(frozen=True)
class Berth:
    """Where one node lives, and where the others do.

    Attributes:
        cluster: the cluster's name, part of every key.
        node: the node's number; it lives on the cell of that number.
        topology: who neighbours whom.
        folder: a private folder for Unix sockets, the same for all nodes of one machine.
        router: the endpoint of the cluster's router.
    """

    cluster: str
    node: int
    topology: str
    folder: Path
    router: str

    @property
    def keys(self) -> Keys:
        """The cluster's key expressions."""
        return Keys(self.cluster)

    @property
    def data_endpoint(self) -> str:
        """Where this node's data session listens."""
        return self.data_endpoint_of(self.node)

    def data_endpoint_of(self, node: int) -> str:
        """Where the data session of a node on this machine listens."""
        return sessions.unix_socket(self.folder, f"n{node}")
