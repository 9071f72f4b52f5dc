"""A node's links to its neighbours: direct ones, and through the router where a direct link is not possible.

The data session is a Zenoh peer with direct links to the neighbours only, so an exchange crosses no router. An open
session takes no further links, so each wiring has a session of its own.

A neighbour that no direct link reaches, because it is on another network, is subscribed to through the router instead,
as long as that is so. A message that comes by both ways is used once, since the cell ignores repeats. Nodes on
different hosts link directly if both listen on a network; where that is impossible no node waits for such a link. The
spy of a cluster of several hosts also receives the root's messages through the router.

Subscriptions and publishers are declared and undeclared on the main thread only: on Zenoh's thread nothing may be
declared. That thread only notes which neighbours are linked.
"""

import contextlib
import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import zenoh

from node.node_config import NodeConfig
from topologies import ROOT, Topology
from wire import access, sessions
from wire.callbacks import direct, frequent
from wire.control import Wiring
from wire.members import member_of_host

_DIRECT_WITHIN = 30.0  # s that a direct link may take to come up; a thousand nodes start in a third of it

_HASTY_WITHIN = 3.0  # s, in place of either, where the neighbours have long started

_ROUTED_WITHIN = 90.0  # s that a neighbour may take after that until it is linked at all

Hear = Callable[[zenoh.Sample], None]
"""A callback for a neighbour's messages, called on Zenoh's thread."""
Task = Callable[[], None]  # for the main thread


class GivenUpError(Exception):
    """The wait for neighbours was given up."""


class Links:
    """The data session of one node in one wiring, and the session by which each neighbour's messages come.

    Args:
        config: the node's configuration.
        topology: the neighbours of each cell.
        wiring: the node on each cell; this node must be among them.
        control: the session through the router.
        make_handler: returns the callback for messages of the given cell.
        later: queues a task for the main thread.
        changed: notified when a neighbour is linked, and when a wait may be given up. Polling instead would make a
            thousand starting nodes keep each other from starting.

    Attributes:
        cell: the cell that this node is on.
        neighbours: the distinct neighbours of that cell, without the cell itself.
        publish: sends a message to every neighbour. It is replaced when a neighbour must be reached through the router,
            so look it up for each message.
        complete: whether every neighbour has been linked once; until then `wait` has to be called.
    """

    def __init__(
        self,
        config: NodeConfig,
        topology: Topology,
        wiring: Wiring,
        control: zenoh.Session,
        make_handler: Callable[[int], Hear],
        later: Callable[[Task], None],
        changed: threading.Condition,
    ) -> None:
        self.keys = config.keys
        self.node = config.node
        self.wiring = wiring
        self.control = control
        self.cell = wiring.nodes.index(config.node)
        slots = topology.neighbours(self.cell)
        self.neighbours = tuple(dict.fromkeys(other for other in slots if other != self.cell))
        self._make_handler = make_handler
        self._later = later
        self._changed = changed
        self._linked: set[int] = set()  # neighbours with a direct link; Zenoh's thread writes it, under `changed`
        self._routed: dict[int, Any] = {}  # neighbours heard through the router, with their subscribers
        self._listening: set[int] = set()  # neighbours known to listen to the router; written like `_linked`
        self._routed_out: zenoh.Publisher | None = None
        # The neighbours to which no direct link is possible.
        self._apart = frozenset(other for other in self.neighbours if self._way_to(config, other) is None)
        self._for_the_spy = self.cell == ROOT and bool(wiring.hosts)
        self._patient = True  # whether `wait` still waits for direct links
        self._closed = False
        self.complete = False
        self._open(config)

    def leads_to(self, topology: Topology, wiring: Wiring) -> bool:
        """Return whether these links serve a job with that topology and wiring."""
        return wiring.number == self.wiring.number and topology.cells == len(self.wiring.nodes)

    def close(self) -> None:
        """Stop receiving and close the data session. Idempotent."""
        self._closed = True  # a `_reroute` that is queued already does nothing then
        for declared in [each for pair in self._routed.values() for each in pair]:
            declared.undeclare()
        self._routed.clear()
        self._stop_publishing_both_ways()
        self.data.close()  # type: ignore[no-untyped-call]

    def _open(self, config: NodeConfig) -> None:
        """Open the data session and declare everything on it.

        Of two neighbours the one on the higher cell connects: when a cluster starts, the other was forked before it.
        A node declares its liveliness token after its subscriptions, on the same link, so a neighbour that sees the
        token may publish to it.
        """
        node_of, endpoints = self.wiring.nodes, self.wiring.endpoints
        here = [config.data_endpoint(self.node, self.wiring.number)]
        abroad = [endpoints[self.cell]] if endpoints and endpoints[self.cell] else []
        ways = [self._way_to(config, other) for other in sorted(self.neighbours) if other < self.cell]
        there = [way for way in ways if way is not None]
        try:
            self.data = sessions.peer([*here, *abroad], there, config.identity, self._access(config))
        except zenoh.ZError:
            if not abroad:
                raise
            # Another process has that port: links from abroad use the router.
            self.data = sessions.peer(here, there, config.identity, self._access(config))
        self._out = self.data.declare_publisher(self.keys.out(self.node))
        self.publish: Callable[[bytes], None] = self._out.put
        self._subscribers = [self._subscribe(self.data, other) for other in self.neighbours]
        liveliness = self.data.liveliness()
        see = partial(self._see, {self.keys.node(node_of[other]): other for other in self.neighbours})
        # One subscriber for all neighbours: no other node is linked, and each subscriber costs a message on each link.
        self._watcher = liveliness.declare_subscriber(self.keys.any_node, direct(see), history=True)
        self._token = liveliness.declare_token(self.keys.node(self.node))

    def _access(self, config: NodeConfig) -> Mapping[str, Any] | None:
        """Return the rules for links from other hosts; None for a node without keys, or without such links."""
        hosts, nodes = self.wiring.hosts, self.wiring.nodes
        if config.identity is None or not hosts:
            return None
        nodes_of: dict[str, list[int]] = {}
        for other in self.neighbours:
            if hosts[other] != hosts[self.cell]:
                nodes_of.setdefault(member_of_host(hosts[other]), []).append(nodes[other])
        return access.of_links(config.cluster, nodes_of)

    def _way_to(self, config: NodeConfig, other: int) -> str | None:
        """Return the endpoint at which a neighbour listens for this node; None if no direct link is possible."""
        hosts, endpoints = self.wiring.hosts, self.wiring.endpoints
        if not hosts or hosts[other] == hosts[self.cell]:
            return config.data_endpoint(self.wiring.nodes[other], self.wiring.number)
        both_listen = bool(endpoints) and bool(endpoints[self.cell]) and bool(endpoints[other])
        return endpoints[other] if both_listen else None

    def _subscribe(self, session: zenoh.Session, sender: int) -> Any:
        return session.declare_subscriber(
            self.keys.out(self.wiring.nodes[sender]), frequent(self._make_handler(sender))
        )

    def _see(self, neighbours: Mapping[str, int], sample: zenoh.Sample) -> None:
        """Note that a direct link has come up or gone. On Zenoh's thread."""
        neighbour = neighbours.get(str(sample.key_expr))
        if neighbour is None:  # this node's own token
            return
        with self._changed:
            if sample.kind == zenoh.SampleKind.PUT:
                self._linked.add(neighbour)
            else:
                self._linked.discard(neighbour)
            self._changed.notify_all()
        self._later(self._reroute)

    def wait(self, given_up: Callable[[], bool], hasty: bool) -> None:
        """Wait until every neighbour is linked; use the router for those without a direct link in time.

        Args:
            given_up: returns whether to wait no longer: a neighbour may have died, and never come.
            hasty: whether to wait for seconds only, because this process takes a dead one's place.

        Raises:
            GivenUpError: if the wait is given up. Another one can follow, for which what is linked by then counts.
            TimeoutError: if a neighbour is not linked through the router either. The links are closed then.
        """
        self._reroute()  # neighbours without any possible direct link
        everybody = set(self.neighbours)
        direct_within = _HASTY_WITHIN if hasty else _DIRECT_WITHIN
        routed_within = _HASTY_WITHIN if hasty else _ROUTED_WITHIN
        if self._patient:
            self._are_there(lambda: self._linked >= everybody - self._apart, direct_within, given_up)
            self._patient = False
            self._reroute()
        if not self._are_there(lambda: self._linked | self._listening >= everybody, routed_within, given_up):
            missing = sorted(everybody - self._linked - self._listening)
            self.close()
            raise TimeoutError(f"no link to cells {', '.join(map(str, missing))}")
        self.complete = True

    def _are_there(self, condition: Callable[[], bool], seconds: float, given_up: Callable[[], bool]) -> bool:
        """Wait for ``condition``, at most so many seconds; return whether it has come true.

        Raises:
            GivenUpError: if the wait is given up.
        """
        with self._changed:
            there = self._changed.wait_for(lambda: condition() or given_up(), seconds)
            if there and not condition():
                raise GivenUpError("stopped linking to neighbours, because a newer command has arrived")
        return there

    def _reroute(self) -> None:
        """Use the router for exactly the neighbours without a direct link, except for those that may still get one.

        Runs on the main thread.
        """
        if self._closed:
            return
        for neighbour in self.neighbours:
            if neighbour in self._linked and neighbour in self._routed:
                for declared in self._routed.pop(neighbour):
                    declared.undeclare()
            elif neighbour not in self._linked | self._routed.keys() and not (
                self._patient and neighbour not in self._apart
            ):
                self._routed[neighbour] = self._route(neighbour)
        both_ways = bool(self._routed) or self._for_the_spy
        if both_ways and self._routed_out is None:
            self._routed_out = self.control.declare_publisher(self.keys.out(self.node))
            self._routed_token = self.control.liveliness().declare_token(self.keys.routed(self.node))
            self.publish = self._publish_both_ways
        elif self._routed_out is not None and not both_ways:
            # Links are mutual: a neighbour whose messages come directly receives this node's directly too.
            self.publish = self._out.put
            self._stop_publishing_both_ways()

    def _stop_publishing_both_ways(self) -> None:
        if self._routed_out is not None:
            self._routed_token.undeclare()  # type: ignore[no-untyped-call]
            self._routed_out.undeclare()  # type: ignore[no-untyped-call]
            self._routed_out = None

    def _publish_both_ways(self, payload: bytes) -> None:
        """Publish on both sessions; may run on Zenoh's thread while the main thread undeclares the routed publisher."""
        routed = self._routed_out
        self._out.put(payload)
        if routed is not None:
            with contextlib.suppress(zenoh.ZError):  # it has been undeclared meanwhile
                routed.put(payload)

    def _route(self, neighbour: int) -> list[Any]:
        """Subscribe to a neighbour through the router, and to the token that says that it publishes there too."""

        def see(_: zenoh.Sample) -> None:
            with self._changed:
                self._listening.add(neighbour)
                self._changed.notify_all()

        subscriber = self._subscribe(self.control, neighbour)
        key = self.keys.routed(self.wiring.nodes[neighbour])
        watcher = self.control.liveliness().declare_subscriber(key, direct(see), history=True)
        return [subscriber, watcher]
