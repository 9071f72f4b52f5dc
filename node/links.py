"""A node's links to its neighbours: direct ones, and through the router where a direct one is not possible.

A session takes no further links once it is open, so another wiring is another session.

The data session is a peer with direct links to the neighbours only, so an exchange crosses no router. A neighbour whom
no direct link reaches (it lives on another network) is heard through the router instead, for as long as that is so;
what comes by both ways the cell ignores once. Nodes on different hosts have direct links if both listen on a network;
where there can be none nobody waits for one. The spy of such a cluster hears the root through the router too.
"""

import contextlib
import threading
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import zenoh

from node.node_config import NodeConfig
from topologies import ROOT, Topology
from wire import sessions
from wire.callbacks import direct, frequent
from wire.control import Wiring

_DIRECT_WITHIN = 30.0  # seconds that a direct link may take to come up; a thousand nodes start in a third of it

_ROUTED_WITHIN = 90.0

Hear = Callable[[zenoh.Sample], None]
"""Called on Zenoh's thread with a neighbour's message."""
Task = Callable[[], None]


class Links:
    """The data session of one node in one wiring, and who is heard by which session.

    Args:
        config: the node's place.
        topology: who neighbours whom.
        wiring: who lives where; this node must be among them.
        control: the session through the router.
        make_handler: makes what takes a neighbour's messages, of the sender's cell.
        later: runs a task on the main thread: on Zenoh's thread nothing may be declared.
        changed: notified when a neighbour is linked, and when ``given_up`` may have changed: a thousand nodes that
            looked for themselves would keep each other from starting.
        given_up: whether nobody wants these links any more, which ends the waiting for neighbours: one may have died.

    Attributes:
        cell: where this node lives.
        publish: sends a message to every neighbour.
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
        given_up: Callable[[], bool],
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
        self._given_up = given_up
        self._changed = changed
        self._linked: set[int] = set()  # the neighbours with a direct link
        self._routed: dict[int, Any] = {}  # the others, with their subscribers
        self._listening: set[int] = set()  # those of them who say that they listen to the router
        self._routed_out: zenoh.Publisher | None = None
        self._apart = frozenset(other for other in self.neighbours if self._way_to(config, other) is None)
        self._for_the_spy = self.cell == ROOT and bool(wiring.hosts)
        self._patient = True  # as long as direct links may still come up
        self._closed = False
        self._open(config)
        try:
            self._wait()
        except TimeoutError:
            self.close()
            raise

    def leads_to(self, topology: Topology, wiring: Wiring) -> bool:
        """Whether these are the links that such a job wants."""
        return wiring.number == self.wiring.number and topology.cells == len(self.wiring.nodes)

    def close(self) -> None:
        """Hear nobody any more. Idempotent."""
        self._closed = True
        for declared in [each for pair in self._routed.values() for each in pair]:
            declared.undeclare()
        self._routed.clear()
        self._stop_publishing_both_ways()
        self.data.close()  # type: ignore[no-untyped-call]

    def _open(self, config: NodeConfig) -> None:
        """Of two neighbours the one on the higher cell connects: on a cluster's start the other was forked before it.

        A node declares its token after its subscriptions, on the same link: who sees the token may publish to it.
        """
        node_of, endpoints = self.wiring.nodes, self.wiring.endpoints
        here = [config.data_endpoint(self.node, self.wiring.number)]
        abroad = [endpoints[self.cell]] if endpoints and endpoints[self.cell] else []
        ways = [self._way_to(config, other) for other in sorted(self.neighbours) if other < self.cell]
        there = [way for way in ways if way is not None]
        try:
            self.data = sessions.peer([*here, *abroad], there)
        except zenoh.ZError:
            if not abroad:
                raise
            self.data = sessions.peer(here, there)  # somebody else has that port: these links go by the router
        self._out = self.data.declare_publisher(self.keys.out(self.node))
        self.publish: Callable[[bytes], None] = self._out.put
        self._subscribers = [self._subscribe(self.data, other) for other in self.neighbours]
        liveliness = self.data.liveliness()
        see = partial(self._see, {self.keys.node(node_of[other]): other for other in self.neighbours})
        # One for all neighbours: nobody else is linked, and each question takes a message by each link.
        self._watcher = liveliness.declare_subscriber(self.keys.any_node, direct(see), history=True)
        self._token = liveliness.declare_token(self.keys.node(self.node))

    def _way_to(self, config: NodeConfig, other: int) -> str | None:
        """Where a neighbour listens to this node; None if there can be no direct link."""
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
        """A direct link has come up or gone."""
        neighbour = neighbours.get(str(sample.key_expr))
        if neighbour is None:  # this node itself
            return
        with self._changed:
            if sample.kind == zenoh.SampleKind.PUT:
                self._linked.add(neighbour)
            else:
                self._linked.discard(neighbour)
            self._changed.notify_all()
        self._later(self._reroute)

    def _wait(self) -> None:
        """Until every neighbour is linked; those who are not in time are heard through the router.

        Raises:
            TimeoutError: if one is not heard by that either.
        """
        self._reroute()
        everybody = set(self.neighbours)
        direct_ones = self._are_there(lambda: self._linked >= everybody - self._apart, _DIRECT_WITHIN)
        self._patient = False
        if not direct_ones:
            self._reroute()
        if not self._are_there(lambda: self._linked | self._listening >= everybody, _ROUTED_WITHIN):
            missing = sorted(everybody - self._linked - self._listening)
            raise TimeoutError(f"no link to cells {', '.join(map(str, missing))}")

    def _are_there(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Whether the neighbours are linked in time.

        Raises:
            TimeoutError: if the links are given up.
        """
        with self._changed:
            there = self._changed.wait_for(lambda: condition() or self._given_up(), seconds)
            if there and not condition():
                raise TimeoutError("other links are wanted by now")
        return there

    def _reroute(self) -> None:
        """Hear exactly those through the router who have no direct link, but for those that may still get one."""
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
            # Links are mutual: who is heard directly hears directly.
            self.publish = self._out.put
            self._stop_publishing_both_ways()

    def _stop_publishing_both_ways(self) -> None:
        if self._routed_out is not None:
            self._routed_token.undeclare()  # type: ignore[no-untyped-call]
            self._routed_out.undeclare()  # type: ignore[no-untyped-call]
            self._routed_out = None

    def _publish_both_ways(self, payload: bytes) -> None:
        routed = self._routed_out
        self._out.put(payload)
        if routed is not None:
            with contextlib.suppress(zenoh.ZError):  # undeclared meanwhile, on the main thread
                routed.put(payload)

    def _route(self, neighbour: int) -> list[Any]:
        """Listen to a neighbour through the router, and for its word that it listens too."""

        def see(_: zenoh.Sample) -> None:
            with self._changed:
                self._listening.add(neighbour)
                self._changed.notify_all()

        subscriber = self._subscribe(self.control, neighbour)
        key = self.keys.routed(self.wiring.nodes[neighbour])
        watcher = self.control.liveliness().declare_subscriber(key, direct(see), history=True)
        return [subscriber, watcher]
