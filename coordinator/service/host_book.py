"""The coordinator's record of hosts: which have joined, with which nodes, and which have left.

A host's liveliness token drops when the host ends, but also when the router does. So a host counts as gone only after
it has stayed away for a while. A host that returns under the same name before that gets the same node numbers, and
the jobs on these nodes continue. One that stays away for longer may only be cut off: it gets its numbers when it comes
back, and no other host does, but jobs that needed them have failed. A host that is about to end may ask first that its
jobs move to other nodes; it counts as gone as soon as its token drops.

A coordinator that takes over knows the hosts from the store, and asks those that it can reach who they are now. Without
the store it would give the numbers of a host that is cut off just then to another one.
"""

import contextlib
import itertools
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import zenoh

from coordinator.jobs.hooks import Hooks
from wire import jobs
from wire.callbacks import direct
from wire.hosts import Host
from wire.jobs import Done, Refused
from wire.keys import Keys
from wire.seal import NOT_OURS, Seal
from wire.strict import Rejected

HOST_TIMEOUT = 120.0
"""Seconds that a host may stay away. A container that is restarted is back within a few; one that was cut off for a
minute needs as long again, until TCP or Zenoh tries once more."""

_ANSWER_WITHIN = 5.0
_MOST_LOST = 4096  # nodes whose numbers are kept for hosts that may only be cut off


@dataclass(frozen=True)
class _Seen:
    """The liveliness token of a host has appeared (``here``) or disappeared."""

    id: str
    here: bool


class HostBook:
    """Gives node numbers to hosts, and notices which hosts have left.

    Zenoh's threads only queue what they receive; one thread of this object handles it, and alone changes the tables
    (after the constructor, which fills them).

    Args:
        session: a Zenoh session through the router.
        keys: the key expressions of the cluster.
        seal: opens what hosts say; only hosts with the cluster's secret may join.
        came: called with a host that has got its numbers, before the host knows them; and with one that is back.
        went: called with a host that is out of reach; it may come back.
        left: called with a host that is gone, or with those of its nodes that it gives up, and with why that is a
            fault: for people, "" if the host had asked to leave.
        drain: called with a host that is about to end; returns those of its nodes that jobs still need.
        complain: called with an error that is nobody's fault but this program's.
        hooks: keeps the hosts for the coordinator that takes over, and knows those of the one before.
        most_nodes: how many nodes may join; None for any number. A host that finds no room gets no numbers, and asks
            again.
        timeout: how many seconds a host may stay away until it counts as gone.
    """

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        seal: Seal,
        came: Callable[[Host], None],
        went: Callable[[Host], None],
        left: Callable[[Host, str], None],
        drain: Callable[[Host], list[int]],
        complain: Callable[[str], None],
        hooks: Hooks,
        most_nodes: int | None = None,
        timeout: float = HOST_TIMEOUT,
    ) -> None:
        self._hooks = hooks
        self._timeout = timeout
        self._complain = complain
        self._most_nodes = most_nodes
        self._session = session
        self._keys = keys
        self._seal = seal
        self._came = came
        self._went = went
        self._left = left
        self._drain = drain
        self._hosts: dict[str, Host] = {}  # by id; their nodes are disjoint
        self._present: set[str] = set()  # ids of hosts whose token exists
        self._gone: set[str] = set()  # ids of hosts whose token has disappeared, until it is back or they are given up
        self._drained: set[str] = set()  # ids of hosts that no job needs and that are about to end
        self._lost: dict[str, Host] = {}  # by id, hosts that were given up, but may only have been cut off
        self._away: dict[str, float] = {}  # ids of the other hosts, with the time (monotonic) when they count as gone
        self._mail: queue.SimpleQueue[zenoh.Query | _Seen] = queue.SimpleQueue()
        self._recall()
        self._ask_all()  # before any host can ask for numbers: those that are in use must not be given again
        self._declared = [
            session.liveliness().declare_subscriber(keys.any_host, direct(self._see), history=True),
            session.declare_queryable(keys.nodes, direct(self._mail.put)),
        ]
        threading.Thread(target=self._work, name="hosts", daemon=True).start()

    def host_of(self, node: int) -> str | None:
        """Return the name of the host that a node runs on; None if no host has it. Any thread may call this."""
        return next((host.name for host in list(self._hosts.values()) if node in host.nodes), None)

    def _recall(self) -> None:
        """Note the hosts that the previous coordinator knew; those that are gone will not come back in time."""
        for host, given_up in self._hooks.known_hosts():
            if given_up:
                self._lost[host.id] = host
            else:
                self._note(host)
        self._kept = self._all()

    def _all(self) -> list[tuple[Host, bool]]:
        """Return all hosts, each with whether it was given up."""
        return [(host, False) for host in self._hosts.values()] + [(host, True) for host in self._lost.values()]

    def _keep(self) -> None:
        """Have the hosts stored if they have changed; if that fails, it is tried again with the next message."""
        if (hosts := self._all()) != self._kept and self._hooks.keep_hosts(hosts):
            self._kept = hosts

    def _ask_all(self) -> None:
        """Note the hosts that joined under the previous coordinator, as they are now."""
        replies = self._session.get(
            self._keys.any_host,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=_ANSWER_WITHIN,
        )
        for reply in replies:
            if reply.ok is not None:
                with contextlib.suppress(Rejected):  # not sealed with the cluster's secret
                    self._note(self._open(str(reply.ok.key_expr), reply.ok.payload))

    def _open(self, key: str, payload: zenoh.ZBytes | None) -> Host:
        """Return the host that a message describes.

        Raises:
            Rejected: if the message is not sealed with the cluster's secret, or cannot be read.
        """
        return Host.decode(self._seal.open(key, b"" if payload is None else payload.to_bytes()))

    def _note(self, host: Host) -> None:
        if host.nodes:
            self._lost.pop(host.id, None)
            # An earlier start of it may be among the others, if that was stored last.
            for other in [*self._hosts.values(), *self._lost.values()]:
                if other.id != host.id and set(other.nodes) & set(host.nodes):
                    self._forget(other.id)
            is_new, self._hosts[host.id] = self._hosts.get(host.id) != host, host
            if host.id not in self._present:  # its token has not been reported yet; until then it counts as away
                self._away[host.id] = time.monotonic() + self._timeout
            if is_new:
                self._came(host)

    def _forget(self, host: str) -> None:
        """Forget a host whose numbers another start of it has."""
        for table in (self._hosts, self._lost, self._away):
            table.pop(host, None)

    def _see(self, sample: zenoh.Sample) -> None:
        host = str(sample.key_expr).rpartition("/")[2]
        self._mail.put(_Seen(host, sample.kind == zenoh.SampleKind.PUT))

    def _work(self) -> None:
        """Handle one message after another, for ever."""
        while True:
            message = self._next()
            try:
                self._handle(message)
            except Exception as error:  # else no host could join or leave any more
                self._complain(f"{type(error).__name__}: {error}")

    def _handle(self, message: zenoh.Query | _Seen | None) -> None:
        if isinstance(message, zenoh.Query):
            with message:
                message.reply(self._keys.nodes, jobs.encode_answer(self._answer(message)))
        elif isinstance(message, _Seen):
            self._notice(message)
        self._give_up_those_away()
        self._keep()

    def _next(self) -> zenoh.Query | _Seen | None:
        due = min(self._away.values(), default=None)
        try:
            return self._mail.get(timeout=None if due is None else max(0.0, due - time.monotonic()))
        except queue.Empty:
            return None

    def _notice(self, seen: _Seen) -> None:
        if seen.here:
            self._present.add(seen.id)
            self._away.pop(seen.id, None)
            if seen.id in self._lost:
                self._note(self._lost.pop(seen.id))
            elif seen.id in self._gone and seen.id in self._hosts:
                self._came(self._hosts[seen.id])
            self._gone.discard(seen.id)
        else:
            self._present.discard(seen.id)
            if seen.id in self._hosts:
                self._gone.add(seen.id)
                self._went(self._hosts[seen.id])
                stay = 0.0 if seen.id in self._drained else self._timeout
                self._away[seen.id] = time.monotonic() + stay

    def _give_up_those_away(self) -> None:
        now = time.monotonic()
        for host in [host for host, due in self._away.items() if due <= now]:
            if self._session.info.routers_zid():
                del self._away[host]
                self._gone.discard(host)
                gone = self._hosts.pop(host)
                if host in self._drained:
                    self._drained.discard(host)
                    self._left(gone, "")
                else:
                    self._lost[host] = gone
                    while sum(len(each.nodes) for each in self._lost.values()) > _MOST_LOST:
                        del self._lost[next(iter(self._lost))]  # the one that has been away for the longest time
                    self._left(gone, f"host {gone.name} has been away for {self._timeout:g} s")
            else:  # this process is cut off from the router, so nothing is known of the host
                self._away[host] = now + self._timeout

    def _answer(self, query: zenoh.Query) -> Done | Refused:
        try:
            asking = self._open(str(query.key_expr), query.payload)
        except Rejected as error:
            if error.reason == NOT_OURS:
                return Refused("this host has another secret than the cluster: give both the same --secret-file")
            return Refused(f"the request to join cannot be read: {error.reason}")
        known = self._hosts.get(asking.id)
        if asking.leaving:
            return Done([] if known is None else self._needed_of(known))
        if known is not None:  # it did not get the first answer
            return self._giving(known.nodes)
        known_ones = (*self._hosts.values(), *self._lost.values())
        before = next((host for host in known_ones if host.name == asking.name), None)
        if before is not None and before.id in self._hosts and before.id not in self._away:
            return Refused(f"a host named {asking.name} has joined already: give this one another name (--host)")
        return self._giving(self._let_in(asking, before))

    def _giving(self, nodes: tuple[int, ...]) -> Done:
        """Return the answer to a host that gets these numbers; none as long as they are not stored, so it asks again.

        A coordinator that takes over would give them to another host if this one was cut off just then.
        """
        self._keep()
        stored = {node for host, _ in self._kept for node in host.nodes}
        return Done(list(nodes) if stored.issuperset(nodes) else [])

    def _needed_of(self, host: Host) -> list[int]:
        """Return the nodes that jobs still need of a host that is about to end."""
        needed = self._drain(host)
        if not needed:
            self._drained.add(host.id)
        return needed

    def _let_in(self, asking: Host, before: Host | None) -> tuple[int, ...]:
        """Give a host its numbers: those that it had ``before`` under that name, then the lowest free ones.

        They are fewer than it wants, or none, if the cluster would have too many nodes.
        """
        old: tuple[int, ...] = ()
        if before is not None:
            self._forget(before.id)
            old = before.nodes[: asking.wants]
            if len(before.nodes) > asking.wants:
                given_up = before.nodes[asking.wants :]
                numbers = ", ".join(map(str, given_up))
                self._left(before.with_nodes(given_up), f"host {before.name} has come back without its nodes {numbers}")
        here = {node for host in self._hosts.values() if host.id not in self._away for node in host.nodes}.union(old)
        known = (*self._hosts.values(), *self._lost.values())
        taken = here.union(*(host.nodes for host in known))
        new = (node for node in itertools.count() if node not in taken)
        wants = asking.wants - len(old)
        if self._most_nodes is not None:
            wants = max(0, min(wants, self._most_nodes - len(here)))
        nodes = (*old, *itertools.islice(new, wants))
        self._note(asking.with_nodes(nodes))
        return nodes
