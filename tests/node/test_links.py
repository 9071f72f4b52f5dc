"""The links of a node: how it waits for its neighbours while commands come and go."""

import contextlib
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from places import until

from node.driver import Driver, make_fast_path
from node.epochs import Epochs
from node.node_config import NodeConfig
from node.telemetry import Telemetry
from node.turn_taking import TurnTaking
from problems import load
from problems.modules import Modules
from wire import sessions
from wire.control import Done, Drop, Prepare, Refused, TellStates, Wiring
from wire.takeover import Takeover

FILE = load(Path(__file__).resolve().parents[2] / "examples" / "rastrigin.toml").with_run(topology="torus 1x2")
PATIENCE = 30.0  # seconds


@pytest.fixture
def nodes():
    """The epochs of two nodes that have no links yet, as of processes that have just taken the place of dead ones."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder, contextlib.ExitStack() as closing:
        router = sessions.unix_socket(Path(folder), "r")
        closing.enter_context(contextlib.closing(sessions.router([router])))
        found = []
        for node in range(2):
            config = NodeConfig("c1", node, "", Path(folder), router, bytes(32), Modules())
            control = closing.enter_context(contextlib.closing(sessions.client(router)))
            telemetry = Telemetry(node, lambda _: None, lambda _: None)
            driver = Driver(lambda *_: None, telemetry, TurnTaking({}), make_fast_path(), lambda *_: None)
            found.append(Epochs(config, control, driver, telemetry))
        yield found
        for each in found:
            if each.links is not None:
                each.links.close()


def to_prepare(number=1):
    """To go on where a dead process was."""
    return Prepare(1, 0, FILE.to_json(), Wiring(number, (0, 1)), 0, takeover=Takeover(0, b""))


def answers(nodes, make_order):
    """What nodes answer that get an order at the same time, each its own."""
    with ThreadPoolExecutor(len(nodes)) as threads:
        orders = [make_order() for _ in nodes]
        for each, order in zip(nodes, orders, strict=True):
            each.note(order)
        waiting = [threads.submit(each.prepare, order) for each, order in zip(nodes, orders, strict=True)]
        return [each.result(PATIENCE) for each in waiting]


def epochs_of(node):
    """The present and the coming one."""
    present, coming = node._driver.assignment, node._driver.coming
    return present and present.epoch, coming and coming.plan.epoch


def test_a_node_begins_an_epoch_that_is_followed_by_another_one(nodes):
    """The command to begin it was lost. Without it the node's neighbours would wait in that epoch for ever."""

    def later(number):
        return Prepare(1, number, FILE.to_json(), Wiring(1, (0, 1)))

    assert [type(each) for each in answers(nodes, to_prepare)] == [Done, Done]
    assert [epochs_of(each) for each in nodes] == [(None, 0)] * 2
    assert [type(each) for each in answers(nodes, lambda: later(1))] == [Done, Done]
    assert [epochs_of(each) for each in nodes] == [(0, 1)] * 2
    refusals = answers(nodes, lambda: later(2))
    assert [each.message for each in refusals] == [f"node {n} has not begun epoch 1 yet: try again" for n in (0, 1)]
    assert [epochs_of(each) for each in nodes] == [(0, 1)] * 2


@pytest.mark.parametrize("ends", [to_prepare(), TellStates(1, 0), Drop(1)])
def test_links_that_wait_for_a_neighbour_go_on_waiting_after_a_newer_command(nodes, ends):
    first, second = nodes
    order = to_prepare()
    with ThreadPoolExecutor(2) as threads:
        first.note(order)
        waiting = threads.submit(first.prepare, order)
        links = until(lambda: first.links)
        first.note(ends)
        assert isinstance(waiting.result(PATIENCE), Refused)
        assert not links.complete
        assert [type(each) for each in answers(nodes, to_prepare)] == [Done, Done]
    assert first.links is links, "a session that begins anew is one more that its neighbours have to link with"
    assert links.complete
    assert second.wirings == [1]


def test_links_of_another_wiring_take_the_place_of_those_that_wait(nodes):
    first, _ = nodes
    orders = [to_prepare(1), to_prepare(2)]
    with ThreadPoolExecutor(1) as thread:
        first.note(orders[0])
        waiting = thread.submit(first.prepare, orders[0])
        until(lambda: first.links)
        first.note(orders[1])
        waiting.result(PATIENCE)
        waiting = thread.submit(first.prepare, orders[1])
        until(lambda: first.wirings == [2])
        first.note(Drop(1))
        assert isinstance(waiting.result(PATIENCE), Refused)


def test_a_neighbour_that_never_comes_is_named_and_the_links_are_closed(nodes, monkeypatch):
    monkeypatch.setattr("node.links._HASTY_WITHIN", 0.1)
    first, _ = nodes
    order = to_prepare()
    first.note(order)
    answer = first.prepare(order)
    assert isinstance(answer, Refused)
    assert "no link to cells 1" in answer.message
    assert first.links is None
    assert first.wirings == []
