"""Every key expression of the wire, in one place.

Keys name nodes and other processes, never jobs: keys that are new with each job would leak in Zenoh.
"""

import re
from dataclasses import dataclass

from wire.strict import Rejected

PREFIX = "supernode"
ANYONE = "anyone"
"""The name of clients that show no certificate."""

_LIFE = re.compile(r".*/(?:spy|node/([0-9]{1,18}))/life/([0-9]{1,18})(?:\+[^-/]*)?(?:-[^/]*)?", re.DOTALL)


@dataclass(frozen=True)
class Keys:
    """The key expressions of one cluster, which is named ``cluster``.

    A method or property without a number names one key; ``any_`` and ``every_`` ones match the keys of all nodes.
    """

    cluster: str

    def out(self, node: int) -> str:
        """Return the key under which a node publishes its exchange messages."""
        return f"{self.node(node)}/out"

    def node(self, node: int) -> str:
        """Return the key of a node's liveliness token, which means that the node takes commands or is linked."""
        return f"{self._base}/node/{node}"

    def life(self, node: int, process: int | str) -> str:
        """Return the key of the liveliness token of the process that runs a node. A replacement has another token.

        ``process`` is the process id; of a node on a host that has joined, "PID-HOST" (see `host_of_life`). Where the
        process before it crashed, the id is followed by "+" and the signal (see `crash_of_life`).
        """
        return f"{self.node(node)}/life/{process}"

    @property
    def any_life(self) -> str:
        """Matches the liveliness tokens of all nodes' processes."""
        return f"{self._base}/node/*/life/*"

    def spy_life(self, process: int | str) -> str:
        """Return the key of the liveliness token of the spy's process."""
        return f"{self.spy}/life/{process}"

    @property
    def any_spy_life(self) -> str:
        """Matches the liveliness token of the spy's process, whichever process that is."""
        return f"{self.spy}/life/*"

    @staticmethod
    def life_of(key: str) -> tuple[int | None, int]:
        """Return the node (None: the spy) and the process id that a key of `life` or `spy_life` names.

        Raises:
            Rejected: if it is no such key. Anything that reaches the router can hold a token of any name.
        """
        found = _LIFE.fullmatch(key)
        if found is None:
            raise Rejected("no such life")
        node, process = found.groups()
        return (None if node is None else int(node)), int(process)

    @staticmethod
    def crash_of_life(key: str) -> str:
        """Return the signal by which the process before the one that such a key names crashed; "" if it did not."""
        return key.rpartition("/")[2].partition("-")[0].partition("+")[2]

    @staticmethod
    def host_of_life(key: str) -> str:
        """Return the host of the process that such a key names; "" for a process that the coordinator launched."""
        return key.rpartition("/")[2].partition("-")[2]

    def host(self, host: str) -> str:
        """Return the key of a host's liveliness token, under which the host also answers which nodes it has."""
        return f"{self._base}/host/{host}"

    @property
    def any_host(self) -> str:
        """Matches the keys of all hosts."""
        return f"{self._base}/host/*"

    @property
    def nodes(self) -> str:
        """The key at which a host asks the coordinator for node numbers, to join."""
        return f"{self._base}/nodes"

    def routed(self, node: int) -> str:
        """Return the key of the liveliness token of a node that listens to some neighbours through the router."""
        return f"{self.node(node)}/routed"

    @property
    def any_node(self) -> str:
        """Matches the liveliness tokens of all nodes."""
        return f"{self._base}/node/*"

    def control(self, node: int) -> str:
        """Return the key at which a node takes commands, from the coordinator and from neighbours."""
        return f"{self.node(node)}/control"

    @property
    def every_control(self) -> str:
        """Matches the `control` keys of all nodes: one query reaches them all."""
        return f"{self._base}/node/*/control"

    def stats(self, node: int) -> str:
        """Return the key under which a node publishes its counters."""
        return f"{self.node(node)}/stats"

    @property
    def any_stats(self) -> str:
        """Matches the `stats` keys of all nodes."""
        return f"{self._base}/node/*/stats"

    @property
    def spy(self) -> str:
        """The key of the spy's liveliness token."""
        return f"{self._base}/spy"

    @property
    def spy_control(self) -> str:
        """The key at which the spy takes commands."""
        return f"{self._base}/spy/control"

    @property
    def spy_counters(self) -> str:
        """The key under which the spy passes on the nodes' counters, those of many nodes in one message."""
        return f"{self._base}/spy/counters"

    @property
    def spy_stats(self) -> str:
        """The key under which the spy publishes the statistics of each job."""
        return f"{self._base}/spy/stats"

    @property
    def log(self) -> str:
        """The key under which every process publishes its log records."""
        return f"{self._base}/log"

    @property
    def best(self) -> str:
        """The key under which the spy publishes each verified improvement, decoded."""
        return f"{self._base}/best"

    @property
    def coordinator(self) -> str:
        """The key of the liveliness token of a coordinator that takes requests."""
        return f"{self._base}/coordinator"

    def requests(self, client: str, right: str) -> str:
        """Return the key at which the coordinator takes a client's requests that need a right.

        The router lets a client with a certificate use the keys of its own name and rights only (`wire.access`). So the
        key proves who asks, and that it may.
        """
        return f"{self._base}/jobs/{client}/{right}"

    @property
    def any_request(self) -> str:
        """Matches the keys at which the coordinator takes requests."""
        return f"{self._base}/jobs/*/*"

    @staticmethod
    def asker_of(key: str) -> tuple[str, str]:
        """Return the client's name and the right that a key of `requests` names."""
        *_, client, right = key.split("/")
        return client, right

    @property
    def state(self) -> str:
        """The key under which the coordinator publishes each change of a job's state."""
        return f"{self._base}/state"

    @property
    def _base(self) -> str:
        return f"{PREFIX}/{self.cluster}"
