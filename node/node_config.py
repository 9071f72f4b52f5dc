"""The configuration of a node or the spy: what it must know before it can open its sessions."""

import os
from dataclasses import dataclass, field
from pathlib import Path

from node.core_token import CoreTokens
from node.evaluation_limits import EvaluationLimits
from problems.modules import Modules
from wire import sessions
from wire.keys import Keys
from wire.members import Identity


@dataclass(frozen=True)
class NodeConfig:
    """The place of one process in a cluster.

    Attributes:
        cluster: the cluster's name, part of every key expression.
        node: the node's number. Until a job says otherwise it is on the cell of that number. Of the spy: the root's.
        topology: the topology to link for at the start. Empty for a node that replaces one that died, which links when
            it is told to prepare for a job.
        folder: a private folder for Unix sockets, the same for all nodes of one host.
        router: the endpoint of the cluster's router.
        secret: the cluster's secret: commands are obeyed if they are sealed with it, see `wire.seal`.
        modules: users' modules that problems may name.
        host: identifies this start of the processes that share ``folder``, in a cluster of several hosts; else empty.
        crash: the signal by which the process before this one crashed, such as "SIGSEGV"; "" if it did not.
        limits: what an evaluation in a user's own code may take.
        identity: who this process shows itself to be on encrypted links; None if there are none.
        core_tokens: the tokens of cores that nodes share, by core. Without one a node breeds whenever it is scheduled.
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
    crash: str = ""
    limits: EvaluationLimits = field(default_factory=EvaluationLimits)
    identity: Identity | None = None

    @property
    def keys(self) -> Keys:
        """The cluster's key expressions."""
        return Keys(self.cluster)

    @property
    def process(self) -> str:
        """This process's name in its liveliness token: process ids alone repeat on other hosts and in later starts."""
        name = f"{os.getpid()}+{self.crash}" if self.crash else str(os.getpid())
        return f"{name}-{self.host}" if self.host else name

    def data_endpoint(self, node: int, wiring: int) -> str:
        """Return the endpoint of a node's data session on this host, for the wiring of that number."""
        return sessions.unix_socket(self.folder, f"n{node}.{wiring}")
