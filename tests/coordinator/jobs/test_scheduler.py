"""Who runs next, and where: whatever comes, no node has two jobs, and nobody is overtaken without a higher priority."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import topologies
from coordinator.jobs.blocks import edges_between
from coordinator.jobs.client_limits import ClientLimits
from coordinator.jobs.scheduler import Placed, QueueFull, Scheduler, TooLarge
from problems import BadInput

TOPOLOGIES = ["torus 2x2", "torus 1x4", "ring 3", "torus 4x4", "complete 5", "ring 1"]
CELLS = {"torus 2x2": 4, "torus 1x4": 4, "ring 3": 3, "torus 4x4": 16, "complete 5": 5, "ring 1": 1}


def scheduler_of(*arguments, clock=lambda: 0.0, **settings):
    """Return a scheduler, for which time stands still by default."""
    return Scheduler(*arguments, clock=clock, **settings)


def run(scheduler, number, topology, priority=0):
    """Add a job, and start what may start."""
    scheduler.add(number, topologies.parse(topology).cells, topology, priority)
    return scheduler.start()


# The queue ------------------------------------------------------------------------------------------------------------
def test_a_job_that_fits_starts_at_once():
    assert run(scheduler_of(16), 1, "torus 4x4") == [Placed(1, tuple(range(16)))]


def test_small_jobs_share_the_nodes():
    scheduler = scheduler_of(16)
    nodes = [placed.nodes for number in range(4) for placed in run(scheduler, number, "torus 2x2")]
    assert nodes == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11), (12, 13, 14, 15)]
    assert run(scheduler, 4, "ring 1") == []
    scheduler.free(2)
    assert scheduler.start() == [Placed(4, (8,))]


def test_each_host_gets_a_block_of_the_cells_on_as_few_hosts_as_possible():
    scheduler = scheduler_of(64, place_of=lambda node: f"host{node % 4}")
    scheduler.add(1, 64, "torus 8x8")
    (placed,) = scheduler.start()
    assert sorted(placed.nodes) == list(range(64))
    assert edges_between(topologies.parse("torus 8x8"), [node % 4 for node in placed.nodes]) == (64, 256)
    scheduler.free(1)
    scheduler.add(2, 64, "torus 8x8")
    assert scheduler.start() == [Placed(2, placed.nodes)], "its links are there already"
    scheduler.free(2)
    scheduler.add(3, 16, "torus 4x4")
    (small,) = scheduler.start()
    assert len({node % 4 for node in small.nodes}) == 1


def test_cells_of_nodes_that_leave_move_to_free_nodes_if_there_are_enough():
    scheduler = scheduler_of(6, place_of=lambda node: f"host{node // 2}")
    run(scheduler, 1, "torus 2x2")
    nodes = scheduler.nodes_of(1)
    (used, other), (spare,) = sorted({node // 2 for node in nodes}), {0, 1, 2} - {node // 2 for node in nodes}
    leaving = [2 * used, 2 * used + 1]
    moved = scheduler.drain(leaving)
    assert moved[1].keys() == set(leaving)
    assert set(moved[1].values()) == {2 * spare, 2 * spare + 1}
    assert scheduler.nodes_of(1) == tuple(moved[1].get(node, node) for node in nodes)
    assert scheduler.drain(leaving) == {}
    assert scheduler.drain([2 * other]) == {}, "no node is free"
    scheduler.free(1)
    assert scheduler.free_nodes == 3
    scheduler.leave(leaving)
    scheduler.join(leaving)
    assert scheduler.free_nodes == 5


def test_nodes_that_are_told_to_leave_before_they_come_get_no_job():
    scheduler = scheduler_of(4, joining=True)
    scheduler.drain([2, 3])
    scheduler.join([0, 1, 2, 3])
    assert scheduler.free_nodes == 2
    assert run(scheduler, 1, "torus 2x2") == []
    scheduler.stay([2, 3])
    assert scheduler.start() == [Placed(1, (0, 1, 2, 3))]


def test_nodes_out_of_reach_keep_their_cells_and_get_no_further_job():
    scheduler = scheduler_of(8)
    assert run(scheduler, 1, "torus 2x2") == [Placed(1, (0, 1, 2, 3))]
    scheduler.rest([2, 3, 4, 5])
    assert run(scheduler, 2, "torus 2x2") == []
    assert scheduler.drain([6]) == {}, "cells of nodes out of reach do not move"
    assert scheduler.nodes_of(1) == (0, 1, 2, 3)
    scheduler.free(1)
    assert scheduler.free_nodes == 3
    scheduler.stay([2, 3, 4, 5])
    assert scheduler.free_nodes == 7


def test_nodes_whose_host_comes_back_before_it_has_ended_get_jobs_again():
    scheduler = scheduler_of(4)
    run(scheduler, 1, "torus 1x2")
    assert scheduler.drain([0, 2]) == {1: {0: 3}}
    scheduler.stay([0, 2])
    assert scheduler.free_nodes == 2
    scheduler.free(1)
    assert scheduler.free_nodes == 4


def test_further_nodes_that_a_job_has_not_taken_are_not_linked():
    scheduler = scheduler_of(16)
    run(scheduler, 1, "torus 2x4")
    assert len(scheduler.extend(1)) == 16
    scheduler.rewired(1, "ring 8")
    scheduler.free(1)
    scheduler.add(2, 8, "ring 8")
    (placed,) = scheduler.start()
    assert placed.nodes == tuple(range(8))


def test_few_hosts_come_before_links_that_are_there_already():
    scheduler = scheduler_of(4, joining=True, place_of=lambda node: f"host{node // 4}")
    scheduler.join([0, 1, 4, 5])
    run(scheduler, 1, "torus 2x2")
    scheduler.free(1)
    scheduler.join([2, 3])
    scheduler.add(2, 4, "torus 2x2")
    (placed,) = scheduler.start()
    assert placed.nodes == (0, 1, 2, 3)


def test_a_job_that_grows_gets_whole_rows_of_free_nodes_unless_a_job_waits():
    scheduler = scheduler_of(19)
    scheduler.add(1, 8, "torus 2x4")
    scheduler.start()
    assert scheduler.extend(1) == (*range(8), *range(8, 16))
    assert (scheduler.nodes_of(1), scheduler.free_nodes) == (tuple(range(16)), 3)
    assert scheduler.extend(1) is None, "three nodes are no row"
    assert scheduler.extend(2) is None, "there is no such job"
    scheduler.free(1)
    scheduler.add(2, 2, "ring 2")
    scheduler.start()
    assert scheduler.extend(2) is None, "a ring has no rows"
    scheduler.add(3, 4, "torus 2x2")
    scheduler.add(4, 16, "torus 4x4")
    scheduler.start()
    assert scheduler.extend(3) is None, "another job waits"


def test_a_large_job_is_not_overtaken_by_a_small_one():
    scheduler = scheduler_of(16)
    run(scheduler, 1, "torus 2x2")
    assert run(scheduler, 2, "torus 4x4") == []
    assert run(scheduler, 3, "ring 1") == []
    assert scheduler.queued == (2, 3)
    scheduler.free(1)
    assert [placed.number for placed in scheduler.start()] == [2]
    scheduler.free(2)
    assert [placed.number for placed in scheduler.start()] == [3]


def test_a_higher_priority_goes_first():
    scheduler = scheduler_of(4)
    run(scheduler, 1, "torus 2x2")
    for number, priority in [(2, 0), (3, 5), (4, -1), (5, 5)]:
        assert run(scheduler, number, "torus 2x2", priority) == []
    assert scheduler.queued == (3, 5, 2, 4)


def test_a_job_that_starts_over_gets_its_old_place():
    scheduler = scheduler_of(4)
    run(scheduler, 1, "torus 2x2")
    run(scheduler, 2, "torus 2x2")
    scheduler.free(1)
    scheduler.add(1, 4, "torus 2x2", accepted_before=True)
    assert scheduler.queued == (1, 2)


def test_a_cancelled_job_leaves_the_queue():
    scheduler = scheduler_of(4)
    run(scheduler, 1, "torus 2x2")
    run(scheduler, 2, "torus 2x2")
    assert scheduler.remove(2)
    assert not scheduler.remove(2)
    assert not scheduler.remove(1)
    assert scheduler.queued == ()
    scheduler.free(1)
    assert scheduler.start() == []
    assert scheduler.free_nodes == 4


def test_a_job_larger_than_the_cluster_is_refused():
    with pytest.raises(TooLarge, match=r"^the job asks for 16 cells \(torus 4x4\), the cluster has 15 nodes$"):
        scheduler_of(15).add(1, 16, "torus 4x4")
    assert issubclass(TooLarge, BadInput)


def test_a_full_queue_is_refused():
    scheduler = scheduler_of(4, ClientLimits(waiting=2))
    for number in range(3):
        run(scheduler, number, "torus 2x2")
    with pytest.raises(QueueFull, match=r"^the queue is full: 2 jobs wait, at most 2 may$"):
        scheduler.add(3, 4, "torus 2x2")
    with pytest.raises(QueueFull):
        scheduler.add(3, 4, "torus 2x2", 1)
    scheduler.add(3, 4, "torus 2x2", accepted_before=True)
    assert scheduler.queued == (1, 2, 3)


def test_whoever_need_not_wait_needs_no_room_in_the_queue():
    scheduler = scheduler_of(4, ClientLimits(waiting=0))
    assert [placed.number for placed in run(scheduler, 1, "ring 3")] == [1]
    with pytest.raises(QueueFull, match="0 jobs wait, at most 0 may"):
        scheduler.add(2, 4, "torus 2x2")
    assert [placed.number for placed in run(scheduler, 2, "ring 1")] == [2]


def test_a_higher_priority_that_fits_passes_a_full_queue():
    scheduler = scheduler_of(4, ClientLimits(waiting=1))
    run(scheduler, 1, "ring 3")
    assert run(scheduler, 2, "torus 2x2") == []
    assert [placed.number for placed in run(scheduler, 3, "ring 1", 1)] == [3]


# The nodes ------------------------------------------------------------------------------------------------------------
def test_the_same_topology_gets_the_same_nodes_though_others_come_between():
    scheduler = scheduler_of(8)
    nodes_of = {topology: set() for topology in ("torus 2x2", "ring 3", "ring 1")}
    for number in range(30):
        topology = list(nodes_of)[number % 3]
        ((_, nodes),) = run(scheduler, number, topology)
        nodes_of[topology].add(nodes)
        scheduler.free(number)
    assert nodes_of == {"torus 2x2": {(0, 1, 2, 3)}, "ring 3": {(4, 5, 6)}, "ring 1": {(7,)}}


@given(st.lists(st.tuples(st.sampled_from(TOPOLOGIES), st.integers(0, 3)), max_size=40))
def test_nodes_wired_for_a_topology_are_taken_again_if_they_are_free(jobs):
    """At most one job at a time, and each topology may keep its nodes: nothing is ever rewired."""
    scheduler = scheduler_of(sum(CELLS.values()))
    first = {}
    for number, (topology, _) in enumerate(jobs):
        ((_, nodes),) = run(scheduler, number, topology)
        assert first.setdefault(topology, nodes) == nodes
        scheduler.free(number)


def test_the_order_of_nodes_found_running_is_kept():
    scheduler = scheduler_of(8)
    scheduler.occupy(7, [6, 2, 5, 1], "torus 2x2")
    assert scheduler.nodes_of(7) == (6, 2, 5, 1)
    assert run(scheduler, 8, "torus 1x4") == [Placed(8, (0, 3, 4, 7))]
    scheduler.free(7)
    assert run(scheduler, 9, "torus 2x2") == [Placed(9, (6, 2, 5, 1))]


def test_nodes_of_a_job_found_running_without_its_topology_may_be_wired_in_any_way():
    scheduler = scheduler_of(4)
    scheduler.occupy(7, (3, 2, 1, 0))
    scheduler.free(7)
    assert run(scheduler, 9, "torus 2x2") == [Placed(9, (0, 1, 2, 3))]


@pytest.mark.parametrize("nodes", [(0,), (8,), (-1,), (3, 3)])
def test_no_node_is_occupied_twice_or_from_nowhere(nodes):
    scheduler = scheduler_of(8)
    scheduler.occupy(1, (0, 1))
    with pytest.raises(ValueError, match="are not all free"):
        scheduler.occupy(2, nodes)
    assert scheduler.free_nodes == 6


def test_rewired_nodes_are_taken_for_what_they_are_now():
    scheduler = scheduler_of(8)
    run(scheduler, 1, "torus 2x2")
    scheduler.rewired(1, "torus 1x4")
    scheduler.free(1)
    assert run(scheduler, 2, "torus 2x2") == [Placed(2, (4, 5, 6, 7))]
    assert run(scheduler, 3, "torus 1x4") == [Placed(3, (0, 1, 2, 3))]


def test_a_new_node_is_wired_to_nobody():
    scheduler = scheduler_of(8)
    for number in (1, 2):
        run(scheduler, number, "torus 2x2")
    scheduler.replaced(5)
    for number in (1, 2):
        scheduler.free(number)
    assert run(scheduler, 3, "torus 2x2") == [Placed(3, (0, 1, 2, 3))]
    assert run(scheduler, 4, "torus 2x2") == [Placed(4, (4, 5, 6, 7))]  # wired anew


# Whatever comes -------------------------------------------------------------------------------------------------------
class AnyOrder(RuleBasedStateMachine):
    """Jobs of two clients come, start, end and are cancelled in any order, on a cluster of any size."""

    @initialize(
        nodes=st.integers(1, 20), waiting=st.none() | st.integers(0, 5), client_nodes=st.none() | st.integers(1, 20)
    )
    def begin(self, nodes, waiting, client_nodes):
        self.limits = ClientLimits(waiting, client_nodes)
        self.scheduler = scheduler_of(nodes, self.limits)
        self.nodes = nodes
        self.clients = {}  # number to client
        self.queued = {}  # number to (priority, topology)
        self.running = {}  # number to nodes
        self.number = 0

    def room(self, client):
        """How many further nodes a client may have."""
        has = sum(len(nodes) for number, nodes in self.running.items() if self.clients[number] == client)
        return self.nodes if self.limits.nodes is None or has == 0 else self.limits.nodes - has

    def ahead(self, client):
        """The numbers of a client's jobs that wait, the next one first."""
        own = [number for number in self.queued if self.clients[number] == client]
        return sorted(own, key=lambda number: (-self.queued[number][0], number))

    @rule(topology=st.sampled_from(TOPOLOGIES), priority=st.integers(-1, 1), client=st.sampled_from("ab"))
    def add(self, topology, priority, client):
        self.number += 1
        cells = CELLS[topology]
        self.clients[self.number] = client
        try:
            self.scheduler.add(self.number, cells, topology, priority, client)
        except TooLarge:
            assert cells > min(self.nodes, self.limits.nodes or self.nodes)
        except QueueFull:
            assert len(self.ahead(client)) >= self.limits.waiting
        else:
            self.queued[self.number] = (priority, topology)

    @rule()
    def start(self):
        for number, nodes in self.scheduler.start():
            assert self.ahead(self.clients[number])[0] == number
            _, topology = self.queued.pop(number)
            assert len(nodes) == CELLS[topology] == len(set(nodes))
            assert set(nodes) <= set(range(self.nodes))
            assert not set(nodes) & {node for busy in self.running.values() for node in busy}
            self.running[number] = nodes
            assert self.room(self.clients[number]) >= 0
        heads = [(CELLS[self.queued[self.ahead(client)[0]][1]], client) for client in "ab" if self.ahead(client)]
        wanted = [cells for cells, client in heads if cells <= self.room(client)]
        # The one whose turn it is waits for free nodes, and others behind it; a client at its limit holds back nobody.
        assert not wanted or max(wanted) > self.nodes - sum(map(len, self.running.values()))

    @precondition(lambda self: self.running)
    @rule(data=st.data())
    def end(self, data):
        number = data.draw(st.sampled_from(sorted(self.running)))
        del self.running[number]
        self.scheduler.free(number)
        self.scheduler.free(number)

    @precondition(lambda self: self.queued)
    @rule(data=st.data())
    def cancel(self, data):
        number = data.draw(st.sampled_from(sorted(self.queued)))
        del self.queued[number]
        assert self.scheduler.remove(number)

    @precondition(lambda self: self.running)
    @rule(data=st.data())
    def restart(self, data):
        """Another coordinator finds the running jobs and the queue again."""
        scheduler = scheduler_of(self.nodes, self.limits)
        for number, nodes in self.running.items():
            scheduler.occupy(number, nodes, client=self.clients[number])
        for number, (priority, topology) in sorted(self.queued.items()):
            scheduler.add(number, CELLS[topology], topology, priority, self.clients[number], accepted_before=True)
        self.scheduler = scheduler

    @invariant()
    def it_keeps_count(self):
        if hasattr(self, "scheduler"):
            assert self.scheduler.free_nodes == self.nodes - sum(map(len, self.running.values()))
            assert sorted(self.scheduler.queued) == sorted(self.queued)
            for client in "ab":
                queued = [number for number in self.scheduler.queued if self.clients[number] == client]
                assert queued == self.ahead(client)

    def teardown(self):
        if not hasattr(self, "scheduler"):
            return
        while self.running or self.queued:
            self.start()
            for number in list(self.running):
                self.scheduler.free(number)
                del self.running[number]
        assert self.scheduler.free_nodes == self.nodes


TestAnyOrder = AnyOrder.TestCase
TestAnyOrder.settings = settings(max_examples=60, stateful_step_count=40)


def test_nodes_join_and_leave():
    scheduler = scheduler_of(4, joining=True)
    assert (scheduler.nodes, scheduler.free_nodes) == (4, 0)
    scheduler.add(1, 4, "ring 4")
    scheduler.join([0, 1, 2])
    assert scheduler.start() == []
    scheduler.join([3, 4])
    assert (scheduler.nodes, scheduler.here) == (5, (0, 1, 2, 3, 4))
    assert scheduler.start() == [Placed(1, (0, 1, 2, 3))]
    assert scheduler.leave([3, 4]) == {1}
    assert (scheduler.nodes, scheduler.free_nodes) == (4, 0)
    scheduler.free(1)
    assert (scheduler.here, scheduler.free_nodes) == ((0, 1, 2), 3)


def test_a_node_that_comes_back_while_its_job_still_has_it_is_not_free():
    scheduler = scheduler_of(2, joining=True)
    scheduler.join([0, 1])
    scheduler.add(1, 2, "ring 2")
    scheduler.start()
    scheduler.leave([1])
    scheduler.join([1])
    assert scheduler.free_nodes == 0
    scheduler.free(1)
    assert scheduler.free_nodes == 2


# Clients --------------------------------------------------------------------------------------------------------------
def test_clients_take_turns_whatever_their_number_of_jobs_and_priorities():
    scheduler = scheduler_of(4)
    for number in range(4):
        scheduler.add(number, 4, "torus 2x2", 1000, "flood")
    assert [placed.number for placed in scheduler.start()] == [0]
    scheduler.add(4, 4, "torus 2x2", 0, "other")
    scheduler.add(5, 4, "torus 2x2", 7, "other")
    assert scheduler.queued == (5, 1, 4, 2, 3), "the other one's turn is longer ago"
    started = []
    for number in (0, 5, 1, 4, 2):
        scheduler.free(number)
        started += [placed.number for placed in scheduler.start()]
    assert started == [5, 1, 4, 2, 3]


def test_a_client_that_fills_its_queue_shuts_out_no_other():
    scheduler = scheduler_of(1, ClientLimits(waiting=1))
    for number in range(2):
        scheduler.add(number, 1, "ring 1", client="flood")
        scheduler.start()
    with pytest.raises(QueueFull, match="the queue is full: 1 jobs wait, at most 1 may"):
        scheduler.add(2, 1, "ring 1", client="flood")
    assert scheduler.queued == (1,)
    scheduler.add(3, 1, "ring 1", client="other")
    assert scheduler.queued == (3, 1)


def test_a_client_with_as_many_nodes_as_it_may_have_is_passed_over():
    scheduler = scheduler_of(8, ClientLimits(nodes=4))
    for number in range(2):
        scheduler.add(number, 4, "torus 2x2", client="flood")
    assert [placed.number for placed in scheduler.start()] == [0]
    scheduler.add(2, 3, "ring 3", client="other")
    assert [placed.number for placed in scheduler.start()] == [2]
    scheduler.free(2)
    assert scheduler.start() == []
    scheduler.free(0)
    assert [placed.number for placed in scheduler.start()] == [1]
    with pytest.raises(
        TooLarge,
        match=r"^the job asks for 6 cells \(torus 2x3\), one client may have 4 nodes; expected a smaller --topology$",
    ):
        scheduler.add(3, 6, "torus 2x3", client="other")


def test_a_job_grows_no_further_than_its_client_may():
    scheduler = scheduler_of(10, ClientLimits(nodes=7))
    scheduler.add(1, 4, "torus 2x2", client="one")
    scheduler.start()
    assert len(scheduler.extend(1)) == 6
    assert scheduler.extend(1) is None


def test_a_job_accepted_when_the_limit_was_higher_runs_alone():
    scheduler = scheduler_of(8, ClientLimits(nodes=4))
    scheduler.add(1, 6, "torus 2x3", client="one", accepted_before=True)
    scheduler.add(2, 1, "ring 1", client="one")
    assert [placed.number for placed in scheduler.start()] == [1]
    scheduler.free(1)
    assert [placed.number for placed in scheduler.start()] == [2]


def test_a_job_that_waits_for_nodes_to_join_is_not_overtaken():
    scheduler = scheduler_of(16, joining=True)
    scheduler.join(range(11))
    scheduler.add(1, 2, "torus 1x2", client="one")
    scheduler.start()
    scheduler.add(2, 12, "torus 3x4", client="two")
    scheduler.add(3, 1, "ring 1", client="three")
    assert (scheduler.start(), scheduler.extend(1)) == ([], None)
    scheduler.join(range(11, 16))
    assert [placed.number for placed in scheduler.start()] == [2, 3]


def test_a_coordinator_that_takes_over_knows_what_each_client_has():
    scheduler = scheduler_of(8, ClientLimits(nodes=4))
    scheduler.occupy(1, range(4), "torus 2x2", "flood")
    scheduler.add(2, 4, "torus 2x2", client="flood")
    assert scheduler.start() == []


def test_a_client_that_comes_back_is_next_and_too_many_names_are_forgotten(monkeypatch):
    monkeypatch.setattr("coordinator.jobs.client_limits._CLIENTS_KEPT", 2)
    scheduler = scheduler_of(1)
    for number, client in enumerate(["polite", "flood", "flood"]):
        scheduler.add(number, 1, "ring 1", client=client)
    assert [placed.number for placed in scheduler.start()] == [0]
    scheduler.free(0)
    assert [placed.number for placed in scheduler.start()] == [1]
    scheduler.add(3, 1, "ring 1", client="polite")
    assert scheduler.queued == (3, 2)
    for number in range(4, 9):
        scheduler.add(number, 1, "ring 1", client=f"made up {number}")
        scheduler.free(number - 3)
        scheduler.start()
    assert len(scheduler._queues._turns) == 2


# Clients with many jobs -----------------------------------------------------------------------------------------------
class Clock:
    """A clock that a test sets."""

    def __init__(self):
        self.now = 100.0

    def __call__(self):
        return self.now


class Flooded:
    """A cluster for one job at a time, of which one client has forty jobs; others come now and then."""

    def __init__(self):
        self.clock = Clock()
        self.scheduler = scheduler_of(4, clock=self.clock)
        self.number = 0
        self.running = []
        for _ in range(40):
            self.submit("flood")

    def submit(self, client):
        """Submit a job, and start what may start."""
        self.number += 1
        self.scheduler.add(self.number, 4, "torus 2x2", client=client)
        return self.start()

    def start(self):
        """Start what may start; return whose jobs start."""
        placed = self.scheduler.start()
        self.running += [each.number for each in placed]
        return [self.scheduler._clients[each.number] for each in placed]

    def end(self, seconds):
        """End the running job after some seconds; return whose job starts in its place."""
        self.clock.now += seconds
        self.scheduler.free(self.running.pop())
        return self.start()


@pytest.fixture
def flooded():
    return Flooded()


@pytest.fixture
def returning(flooded):
    """A flooded cluster, on which a job of a client runs that has come back at once the last time."""
    flooded.submit("robot")
    assert flooded.end(0.1) == ["robot"]
    assert flooded.end(0.1) == ["flood"], "nothing is known of this client yet"
    flooded.submit("robot")
    assert flooded.end(0.05) == ["robot"]
    return flooded


def test_a_client_with_many_jobs_lets_others_go_first(flooded):
    flooded.submit("robot")
    flooded.submit("robot")
    assert [flooded.end(0.1) for _ in range(4)] == [["robot"], ["robot"], ["flood"], ["flood"]]


def test_a_client_with_many_jobs_has_its_turn_after_some_seconds(flooded):
    for _ in range(3):
        flooded.submit("robot")
    assert [flooded.end(4.9), flooded.end(0.2), flooded.end(0.1)] == [["robot"], ["flood"], ["robot"]]


def test_a_client_with_many_jobs_has_its_turn_after_some_jobs_of_others(flooded):
    started = []
    for _ in range(68):
        flooded.submit("robot")
        started += flooded.end(0.01)
    assert started == [*["robot"] * 32, "flood", *["robot"] * 32, "flood", *["robot"] * 2]


def test_clients_with_many_jobs_take_turns(flooded):
    for _ in range(12):
        flooded.submit("researcher")
    started = [flooded.end(0.1)[0] for _ in range(6)]
    assert started == ["researcher", "flood"] * 3


def test_nodes_are_kept_for_a_client_that_comes_back_at_once(returning):
    assert returning.end(0.1) == []
    assert returning.scheduler.look_again_at == pytest.approx(returning.clock.now + 0.15)
    assert returning.submit("flood") == []
    assert returning.submit("robot") == ["robot"]
    assert returning.end(0.1) == []
    returning.clock.now = returning.scheduler.look_again_at
    assert returning.start() == ["flood"]
    assert returning.scheduler.look_again_at is None


def test_no_nodes_are_kept_from_a_client_with_few_jobs(returning):
    returning.submit("other")
    assert returning.end(0.1) == ["other"]


def test_no_nodes_are_kept_from_a_client_whose_turn_has_come(returning):
    returning.clock.now += 4.9
    assert returning.end(0.1) == ["flood"]


def test_a_returning_client_that_cancels_its_job_is_waited_for_no_longer(returning):
    assert returning.end(0.1) == []
    assert returning.submit("robot") == ["robot"]
    returning.submit("robot")
    assert returning.scheduler.remove(returning.number)
    assert returning.end(0.1) == [], "it may come again: its last job has ended just now"
    returning.scheduler.add(99, 4, "torus 2x2", client="robot")
    assert returning.scheduler.remove(99)
    assert returning.start() == ["flood"]


@pytest.fixture
def of_eight():
    """A cluster of eight nodes, and a returning client whose last job had four; another client has many of four."""
    clock = Clock()
    scheduler = scheduler_of(8, clock=clock)
    for number, client in enumerate(["robot", *["flood"] * 12]):
        scheduler.add(number, 4, "torus 2x2", client=client)
    assert [placed.number for placed in scheduler.start()] == [0, 1]
    for number, last in ((20, 0), (21, 20)):
        clock.now += 0.1
        scheduler.free(last)
        scheduler.add(number, 4, "torus 2x2", client="robot")
        assert [placed.number for placed in scheduler.start()] == [number]
    clock.now += 0.1
    scheduler.free(21)
    return scheduler


def test_only_as_many_nodes_are_kept_as_the_client_had(of_eight):
    assert of_eight.start() == []
    of_eight.free(1)
    assert [placed.number for placed in of_eight.start()] == [2]
    assert of_eight.free_nodes == 4


def test_a_job_does_not_grow_into_nodes_that_are_kept(of_eight):
    for number in range(2, 13):
        of_eight.remove(number)
    assert of_eight.extend(1) is None
    of_eight._clock.now += 0.2
    assert len(of_eight.extend(1)) == 8


@pytest.mark.parametrize(("cells", "topology", "starts"), [(4, "torus 2x2", []), (5, "complete 5", [2])])
def test_no_nodes_are_kept_from_a_much_larger_job(cells, topology, starts):
    clock = Clock()
    scheduler = scheduler_of(cells, clock=clock)
    for number in (0, 1):  # it comes back at once
        scheduler.add(number, 1, "ring 1", client="robot")
        scheduler.start()
        clock.now += 0.5
        if number == 1:
            for other in range(2, 12):
                scheduler.add(other, cells, topology, client="flood")
        scheduler.free(number)
    assert [placed.number for placed in scheduler.start()] == starts


class BesidesALongJob:
    """A cluster of eight nodes, of which a long job has four from second 100 on; a second later others submit jobs."""

    def __init__(self, client):
        self.clock = Clock()
        self.scheduler = scheduler_of(8, clock=self.clock)
        self.submit(client, range(1), 4)
        self.starts([0])
        self.clock.now += 1.0

    def submit(self, client, numbers, cells):
        for number in numbers:
            self.scheduler.add(number, cells, f"torus 2x{cells // 2}", client=client)

    def starts(self, numbers):
        assert [placed.number for placed in self.scheduler.start()] == numbers

    def starts_only_at(self, second, number):
        """A job starts at that second, though nothing happens before."""
        self.starts([])
        assert self.scheduler.look_again_at == second
        self.clock.now = second
        self.starts([number])


def test_a_turn_comes_though_nothing_happens_before():
    """A larger job is next, which lacks nodes; a smaller one of a client with many jobs would find enough."""
    cluster = BesidesALongJob("flood")
    cluster.submit("robot", [1], 4)
    cluster.starts([1])
    cluster.submit("flood", range(2, 8), 4)
    cluster.submit("robot", [8], 8)
    cluster.clock.now += 1.0
    cluster.scheduler.free(1)
    cluster.starts_only_at(106.0, 2)


def test_a_turn_comes_though_the_next_client_has_many_jobs_too():
    cluster = BesidesALongJob("long")
    cluster.submit("small", range(1, 8), 4)
    cluster.starts([1])
    cluster.clock.now += 1.0
    cluster.submit("large", range(8, 14), 8)
    cluster.scheduler.free(1)
    cluster.starts_only_at(106.0, 2)


def test_nothing_need_be_looked_for_again_where_one_client_has_all_jobs(flooded):
    assert flooded.scheduler.look_again_at is None
