"""A node's place in a cluster: what it must be told before it can link itself."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from node.core_token import CoreTokens
from problems.modules import Modules
from wire import sessions
from wire.keys import Keys


@dataclass(frozen=True)
class NodeConfig:
    """Where one node lives, and where the others do.

    Attributes:
        cluster: the cluster's name, part of every key.
        node: the node's number; until a job says otherwise it lives on the cell of that number.
        topology: who neighbours whom; empty for a node that takes the place of a dead one: a job will tell it.
        folder: a private folder for Unix sockets, the same for all nodes of one machine.
        router: the endpoint of the cluster's router.
        secret: of the cluster: commands are obeyed if they are sealed with it; see `wire.seal`.
        modules: users' modules that problems may name.
        host: names this start of the processes that share ``folder``, if the cluster's live in several places.
        core_tokens: for the nodes that share a core; who has none breeds when the kernel lets it.
    """

    cluster: str
    node: int
    topology: str
    folder: Path
    router: str
    secret: bytes
    modules: Modules
    host: str = ""
    core_tokens: CoreTokens = field(default_factory=dict)

    @property
    def keys(self) -> Keys:
        """The cluster's key expressions."""
        return Keys(self.cluster)

    @property
    def process(self) -> str:
        """This process, as its token names it: ids repeat from host to host and from one start of it to the next."""
        return f"{os.getpid()}-{self.host}" if self.host else str(os.getpid())

    def data_endpoint(self, node: int, wiring: int) -> str:
        """Where the data session of a node on this machine listens, for the links of that wiring."""
        return sessions.unix_socket(self.folder, f"n{node}.{wiring}")
