"""The book of hosts: numbers, names, hosts that stay away, and a coordinator that takes over."""

import contextlib
import queue
import tempfile
import time
from itertools import count
from pathlib import Path

import pytest
from places import until

from coordinator.jobs.client_limits import NO_LIMITS
from coordinator.jobs.hooks import NoHooks
from coordinator.jobs.node_hosts import PORTS, NodeHosts
from coordinator.service import host_book
from coordinator.service.host_book import HostBook
from coordinator.service.joined import JoinedDispatcher
from wire import jobs, sessions
from wire.callbacks import direct
from wire.control import Wiring
from wire.hosts import Host
from wire.jobs import Done, Refused
from wire.keys import Keys
from wire.seal import Seal
from wire.strict import pack

KEYS = Keys("c1")
SECRET = bytes(range(32))


class Memory(NoHooks):
    """Keeps the hosts as a store does."""

    def __init__(self):
        self.hosts = []
        self.is_full = False

    def known_hosts(self):
        return self.hosts

    def keep_hosts(self, hosts):
        if not self.is_full:
            self.hosts = list(hosts)
        return not self.is_full


class Room:
    """A router, a book, and hosts that the test plays."""

    def __init__(self, endpoint):
        self.endpoint = endpoint
        self.router = sessions.router([endpoint])
        self.sessions = {}
        self.tokens = {}  # a token that nobody holds is gone
        self.left = queue.SimpleQueue()  # hosts, each with the fault
        self.came = []
        self.went = []
        self.memory = Memory()
        self.needed = []  # nodes that jobs need of a host that is about to end
        self.book = self.open_book()

    def open_book(self, most_nodes=None):
        session = self.sessions["book"] = sessions.client(self.endpoint)
        self.complaints = []
        callbacks = (
            self.came.append,
            self.went.append,
            lambda *left: self.left.put(left),
            lambda host: list(self.needed),
            self.complaints.append,
        )
        return HostBook(session, KEYS, Seal(SECRET), *callbacks, self.memory, most_nodes)

    def arrive(self, host):
        """A host's session, with its token and its answer to a new coordinator."""
        session = self.sessions[host.id] = sessions.client(self.endpoint)
        self.tokens[host.id] = session.liveliness().declare_token(KEYS.host(host.id))
        present, seal, key = [host], Seal(SECRET), KEYS.host(host.id)

        def answer(query):
            with query:
                query.reply(key, seal.close(key, present[0].encode()))

        session.declare_queryable(key, direct(answer))
        return present

    def ask(self, host):
        return self.ask_sealed(self.sessions[host.id], host.encode())

    def ask_sealed(self, session, payload, secret=SECRET):
        return self.ask_raw(session, Seal(secret).close(KEYS.nodes, payload))

    def ask_raw(self, session, payload):
        """As hosts do, again until there is an answer: nobody answers before the router has heard of the book."""
        until = time.monotonic() + 10.0
        while time.monotonic() < until:
            for reply in session.get(KEYS.nodes, payload=payload, timeout=10.0):
                return jobs.decode_answer(reply.ok.payload.to_bytes())
        raise TimeoutError("the book does not answer")

    def join(self, id, name, wants):
        """Arrive, ask, and say so from then on."""
        host = Host(id, name, wants)
        present = self.arrive(host)
        answer = self.ask(host)
        if isinstance(answer, Done):
            present[0] = host.with_nodes(tuple(answer.value))
            return present[0].nodes
        return answer

    def go(self, id):
        self.sessions.pop(id).close()
        self.tokens.pop(id, None)

    def close(self):
        for session in [*self.sessions.values(), self.router]:
            session.close()


@pytest.fixture
def room():
    with (
        tempfile.TemporaryDirectory(dir="/dev/shm") as folder,
        contextlib.closing(Room(sessions.unix_socket(Path(folder), "r"))) as room,
    ):
        yield room


def test_each_gets_the_lowest_numbers_that_nobody_has_and_the_same_when_it_asks_again(room):
    assert room.join("a1", "a", 2) == (0, 1)
    assert room.join("b1", "b", 3) == (2, 3, 4)
    assert room.ask(Host("a1", "a", 2)) == Done([0, 1])
    assert [host.nodes for host in room.came] == [(0, 1), (2, 3, 4)]


def test_a_name_is_had_once(room):
    room.join("a1", "a", 2)
    assert room.join("a2", "a", 2) == Refused("a host named a has joined already: give this one another name (--host)")


def test_one_that_comes_again_in_time_gets_its_numbers_again(room):
    room.join("a1", "a", 2)
    room.join("b1", "b", 2)
    room.go("a1")
    assert until_let_in(room, "a2", "a", 3) == (0, 1, 4)
    room.go("b1")
    assert until_let_in(room, "b2", "b", 1) == (2,)
    left, fault = room.left.get(timeout=10)
    assert (left.nodes, fault) == ((3,), "host b has come back without its nodes 3")


def test_one_gets_no_numbers_before_they_are_stored(room):
    assert room.join("a1", "a", 2) == (0, 1)
    room.memory.is_full = True
    assert room.join("b1", "b", 1) == ()
    assert room.ask(Host("a1", "a", 2)) == Done([0, 1])
    room.memory.is_full = False
    assert room.ask(Host("b1", "b", 1)) == Done([2])


def test_one_that_stays_away_has_left(room):
    room.book._timeout = 0.2
    room.join("a1", "a", 2)
    room.join("b1", "b", 1)
    room.go("a1")
    left, fault = room.left.get(timeout=10)
    assert (left.nodes, fault) == ((0, 1), "host a has been away for 0.2 s")
    assert room.join("c1", "c", 3) == (3, 4, 5), "it may only be cut off: nobody else gets its numbers"
    assert room.join("a2", "a", 3) == (0, 1, 6)
    assert room.left.empty()


def test_one_that_was_cut_off_for_long_gets_its_numbers_back(room):
    room.book._timeout = 0.2
    room.join("a1", "a", 2)
    token = room.tokens.pop("a1")
    token.undeclare()
    assert room.left.get(timeout=10)[0].nodes == (0, 1)
    assert room.book.host_of(1) is None
    room.came.clear()
    room.tokens["a1"] = room.sessions["a1"].liveliness().declare_token(KEYS.host("a1"))
    until(lambda: room.book.host_of(1) == "a")
    assert [host.nodes for host in room.came] == [(0, 1)]


@pytest.mark.parametrize("in_vain", [0, 2])
def test_its_nodes_are_back_with_it_though_they_were_never_away(room, monkeypatch, in_vain):
    """As those are that are back a moment before their host is given up. Zenoh may not tell of them at first."""
    room.go("book")
    session = room.sessions["dispatcher"] = sessions.client(room.endpoint)
    hooks, seal = room.memory, Seal(SECRET)
    dispatcher = JoinedDispatcher(session, KEYS, 2, hooks, seal=seal, limits=NO_LIMITS, host_timeout=1.0)
    room.join("a1", "a", 2)
    liveliness = room.sessions["a1"].liveliness()
    lives = [liveliness.declare_token(KEYS.life(node, f"{4711 + node}-a1")) for node in (0, 1)]
    until(lambda: len(dispatcher.nodes()) == 2)
    room.tokens.pop("a1").undeclare()
    until(lambda: dispatcher._forgotten == {0, 1})
    assert not dispatcher.nodes()
    monkeypatch.setattr("coordinator.service.joined._AWAITED_EVERY", 0.01)
    look_for, blind = dispatcher._roster.look_for, [True] * in_vain
    monkeypatch.setattr(dispatcher._roster, "look_for", lambda nodes: blind.pop() if blind else look_for(nodes))
    room.tokens["a1"] = liveliness.declare_token(KEYS.host("a1"))
    until(lambda: [node["process"] for node in dispatcher.nodes()] == [4711, 4712])
    assert len(lives) == 2


def test_a_host_gets_fewer_numbers_or_none_where_there_is_no_room(room):
    room.go("book")
    room.open_book(most_nodes=3)
    assert room.join("a1", "a", 2) == (0, 1)
    assert room.join("b1", "b", 2) == (2,)
    assert room.join("c1", "c", 1) == ()
    room.go("a1")
    assert until_let_in(room, "a2", "a", 1) == (0,)


def test_a_mistake_in_handling_one_message_does_not_end_the_book(room, monkeypatch):
    def fail(host):
        monkeypatch.undo()
        raise ValueError("a mistake")

    monkeypatch.setattr(room.book, "_came", fail)
    assert isinstance(room.join("a1", "a", 2), Refused), "the same message again"
    assert room.ask(Host("a1", "a", 2)) == Done([0, 1])
    assert room.complaints == ["ValueError: a mistake"]


def test_a_coordinator_that_takes_over_asks_who_is_there(room):
    room.join("a1", "a", 2)
    room.arrive(Host("b1", "b", 2))  # it has not asked yet
    room.go("book")
    room.came.clear()
    room.memory.hosts = []  # so it has another database
    room.open_book()
    assert [host.nodes for host in room.came] == [(0, 1)]
    assert room.ask(Host("b1", "b", 2)) == Done([2, 3])


def test_a_host_that_says_that_it_leaves_is_gone_with_its_token(room):
    room.join("a1", "a", 2)
    leaving = Host("a1", "a", 2, nodes=(0, 1), leaving=True)
    room.needed = [1]
    assert room.ask(leaving) == Done([1])
    room.needed = []
    assert room.ask(leaving) == Done([])
    assert room.left.empty()
    room.go("a1")
    left, fault = room.left.get(timeout=host_book.HOST_TIMEOUT / 3)
    assert (left.nodes, fault) == ((0, 1), ""), "that is no fault"
    assert room.join("b1", "b", 2) == (0, 1)


def test_a_stranger_that_leaves_is_missed_by_nobody(room):
    room.arrive(Host("a1", "a", 2))
    assert room.ask(Host("a1", "a", 2, leaving=True)) == Done([])


@pytest.mark.parametrize("payload", [b"", b"\xc1", pack([99, "a", "b", 1, "", []]), pack([1, "a", "b", 2, "", [1]])])
def test_nonsense_is_refused(room, payload):
    session = room.sessions["book"]
    answer = room.ask_sealed(session, payload)
    assert isinstance(answer, Refused)
    assert answer.message.startswith("the request to join cannot be read: ")


def test_a_host_that_is_cut_off_when_the_coordinator_is_replaced_keeps_its_numbers(room):
    assert room.join("a1", "a", 2) == (0, 1)
    assert room.join("b1", "b", 1) == (2,)
    room.go("a1")
    room.sessions["book"].close()
    room.came.clear()
    room.book = room.open_book()
    assert {host.id: host.nodes for host in room.came} == {"a1": (0, 1), "b1": (2,)}
    assert room.join("c1", "c", 2) == (3, 4), "those of a host that may come back are not given to another one"
    assert until_let_in(room, "a2", "a", 2) == (0, 1)


def test_a_host_that_was_given_up_is_still_known_to_the_next_coordinator(room):
    room.book._timeout = 0.2
    assert room.join("a1", "a", 2) == (0, 1)
    room.go("a1")
    assert room.left.get(timeout=10.0)[0].id == "a1"
    until(lambda: [given_up for _, given_up in room.memory.hosts] == [True])
    room.sessions["book"].close()
    room.came.clear()
    room.book = room.open_book()
    assert room.came == []
    assert room.join("b1", "b", 1) == (2,)


def test_who_does_not_know_the_secret_is_not_let_in(room):
    session, stop_request = room.sessions["book"], Host("a1", "a", 2).encode()
    for answer in (room.ask_raw(session, stop_request), room.ask_sealed(session, stop_request, b"another" * 4)):
        assert answer == Refused(
            "this host has another secret than the cluster: give both the same --secret-file", "input"
        )
    assert room.came == []


def test_a_new_coordinator_does_not_believe_a_stranger_who_says_that_he_is_a_host(room):
    stranger = room.sessions["stranger"] = sessions.client(room.endpoint)
    said = Host("x1", "x", 2, "", (0, 1)).encode()

    def answer(query):
        with query:
            query.reply(KEYS.host("x1"), said)

    stranger.declare_queryable(KEYS.host("x1"), direct(answer))
    room.sessions["book"].close()
    room.book = room.open_book()
    assert room.came == []
    assert room.join("a1", "a", 2) == (0, 1)


def until_let_in(room, id, name, wants):
    """Its token may drop a moment later than its session has closed."""
    host = Host(id, name, wants)
    room.arrive(host)
    for _ in range(1000):
        if isinstance(answer := room.ask(host), Done):
            return tuple(answer.value)
    raise AssertionError(answer)


def test_a_node_is_where_its_host_is():
    node_hosts = NodeHosts()
    node_hosts.move_in(Host("x1", "a", 2, nodes=(0, 1), label="hall2/rack7"))
    node_hosts.move_in(Host("x2", "b", 1, nodes=(2,)))
    assert [node_hosts.place_of(node) for node in (0, 1, 2, 3)] == ["hall2/rack7/a", "hall2/rack7/a", "b", ""]


def test_a_wiring_says_where_nodes_live_and_listen():
    node_hosts = NodeHosts()
    assert node_hosts.wiring(7, (0, 1)) == Wiring(7, (0, 1))
    node_hosts.move_in(Host("a", "a", 2, "tcp/10.0.0.1:7000", (0, 1)))
    node_hosts.move_in(Host("b", "b", 2, "", (2, 3)))
    assert node_hosts.wiring(8, (1, 0)) == Wiring(8, (1, 0), ("a", "a")), "they need no network"
    wirings = [node_hosts.wiring(9 + turn, (0, 1, 2)) for turn in range(PORTS + 1)]
    assert {wiring.hosts for wiring in wirings} == {("a", "a", "b")}
    assert wirings[0].endpoints == ("tcp/10.0.0.1:7001", "tcp/10.0.0.1:7005", "")
    assert wirings[1].endpoints == ("tcp/10.0.0.1:7002", "tcp/10.0.0.1:7006", "")
    assert wirings[PORTS].endpoints == wirings[0].endpoints
    assert wirings[PORTS - 1].endpoints == ("tcp/10.0.0.1:7000", "tcp/10.0.0.1:7004", "")


@pytest.mark.parametrize("given_up", range(7))
def test_a_node_does_not_listen_where_its_old_links_may_be_open(given_up):
    node_hosts, numbers, nodes = NodeHosts(), count(100), (0, 1, 2)
    host = Host("a", "a", 2, "tcp/10.0.0.1:7000", (0, 1))
    node_hosts.move_in(host)
    node_hosts.move_in(Host("b", "b", 1, "tcp/10.0.0.2:7000", (2,)))
    open_ports = [node_hosts.taken_over(41, nodes).number % PORTS]
    for turn in range(20):
        if turn == 10:  # it counts as gone, and is back with its old processes
            node_hosts.leave(host.nodes)
            node_hosts.move_in(host)
        closing = []
        for _ in range(given_up + 1):  # with the last one an epoch begins; the others are given up, since processes die
            made = node_hosts.wiring(node_hosts.number(numbers, nodes), nodes)
            assert made.number % PORTS not in open_ports + closing
            closing = [made.number % PORTS]  # until a node has got the next one
        node_hosts.begun(made.number, nodes)
        open_ports = [*open_ports[-1:], made.number % PORTS]
        node_hosts.number(numbers, (2,))  # other jobs take numbers too


def test_a_node_does_not_listen_at_ports_that_it_has_told():
    node_hosts, numbers, nodes = NodeHosts(), count(100), (0, 1)
    node_hosts.taken_over(41, nodes)
    for node in nodes:
        node_hosts.open_links(node, (40, 41, 43))
    for _ in range(3):  # the coordinator gives up what it prepares
        assert node_hosts.number(numbers, nodes) % PORTS == 42 % PORTS
    node_hosts.begun(102, nodes)
    assert {node_hosts.number(numbers, nodes) % PORTS for _ in range(3)} == {40 % PORTS, 43 % PORTS}
