"""Every key expression of the wire, in one place. They are per node, never per job: fresh keys for each job leak."""

from dataclasses import dataclass

PREFIX = "supernode"


@dataclass(frozen=True)
class Keys:
    """The key expressions of one cluster."""

    cluster: str

    def out(self, node: int) -> str:
        """Where a node publishes its exchange messages."""
        return f"{self.node(node)}/out"

    def node(self, node: int) -> str:
        """The liveliness token of a node."""
        return f"{self._base}/node/{node}"

    def life(self, node: int, process: int | str) -> str:
        """The liveliness token of a node's process: another process on the same node has another token."""
        return f"{self.node(node)}/life/{process}"

    @property
    def any_life(self) -> str:
        """The processes of all nodes."""
        return f"{self._base}/node/*/life/*"

    def spy_life(self, process: int | str) -> str:
        """The liveliness token of the spy's process."""
        return f"{self.spy}/life/{process}"

    @property
    def any_spy_life(self) -> str:
        """Whatever process is the spy."""
        return f"{self.spy}/life/*"

    @staticmethod
    def life_of(key: str) -> tuple[int | None, int]:
        """The node, None for the spy, and the process that such a token names."""
        *_, whose, _, life = key.split("/")
        return (None if whose == "spy" else int(whose)), int(life.partition("-")[0])

    @staticmethod
    def home_of(key: str) -> str:
        """The host of that process; "" for the coordinator's."""
        return key.rpartition("/")[2].partition("-")[2]

    def host(self, host: str) -> str:
        """The liveliness token of a host of nodes that have joined, and where it tells which nodes those are."""
        return f"{self._base}/host/{host}"

    @property
    def any_host(self) -> str:
        """All hosts that have joined."""
        return f"{self._base}/host/*"

    @property
    def nodes(self) -> str:
        """Where the coordinator gives numbers to nodes that want to join."""
        return f"{self._base}/nodes"

    def routed(self, node: int) -> str:
        """The liveliness token of a node that hears some neighbours through the router."""
        return f"{self.node(node)}/routed"

    @property
    def any_node(self) -> str:
        """The liveliness tokens of all nodes."""
        return f"{self._base}/node/*"

    def control(self, node: int) -> str:
        """Where a node takes commands and questions."""
        return f"{self.node(node)}/control"

    @property
    def every_control(self) -> str:
        """All nodes' commands at once."""
        return f"{self._base}/node/*/control"

    def stats(self, node: int) -> str:
        """Where a node publishes its counters."""
        return f"{self.node(node)}/stats"

    @property
    def any_stats(self) -> str:
        """The counters of all nodes."""
        return f"{self._base}/node/*/stats"

    @property
    def spy(self) -> str:
        """The liveliness token of the spy."""
        return f"{self._base}/spy"

    @property
    def spy_control(self) -> str:
        """Where the spy takes commands."""
        return f"{self._base}/spy/control"

    @property
    def spy_counters(self) -> str:
        """Where the spy passes on the nodes' counters, those of many at once."""
        return f"{self._base}/spy/counters"

    @property
    def spy_stats(self) -> str:
        """Where the spy publishes statistics of the whole cluster."""
        return f"{self._base}/spy/stats"

    @property
    def log(self) -> str:
        """Where any process publishes what people should know."""
        return f"{self._base}/log"

    @property
    def best(self) -> str:
        """Where the spy publishes each verified improvement, decoded."""
        return f"{self._base}/best"

    @property
    def coordinator(self) -> str:
        """The liveliness token of a coordinator that takes jobs."""
        return f"{self._base}/coordinator"

    @property
    def jobs(self) -> str:
        """Where the coordinator takes jobs, and questions about them."""
        return f"{self._base}/jobs"

    @property
    def state(self) -> str:
        """Where the coordinator publishes each change of a job's state."""
        return f"{self._base}/state"

    @property
    def _base(self) -> str:
        return f"{PREFIX}/{self.cluster}"
