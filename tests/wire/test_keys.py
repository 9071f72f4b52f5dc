"""Key expressions: every thing has its own, and none is another cluster's."""

import inspect
import itertools

import pytest
import zenoh

from wire.keys import PREFIX, Keys
from wire.strict import Rejected

HOSTS = ("h1", "a-host")
CLIENTS, RIGHTS = ("anna", "bob"), ("watch", "submit")
STATIC = ("life_of", "host_of_life", "crash_of_life", "asker_of")
NAMES = {"client": CLIENTS, "right": RIGHTS, "process": (1, 4711, "1-h1", "4711-h1", "1-a-host"), "host": HOSTS}


def all_keys(cluster="c1", nodes=(0, 1, 12)):
    """Every key of a cluster that is no pattern, by name and by what it is the key of."""
    keys = Keys(cluster)
    found = {}
    for name in dir(Keys):
        if name.startswith(("_", "any_", "every_")) or name in ("cluster", *STATIC):
            continue
        value = getattr(keys, name)
        if callable(value):
            of = [NAMES.get(parameter, nodes) for parameter in inspect.signature(value).parameters]
            found |= {(name, *numbers): value(*numbers) for numbers in itertools.product(*of)}
        else:
            found[name] = value
    return found


def test_every_key_is_another():
    keys = all_keys()
    assert len(keys) >= 12
    assert len(set(keys.values())) == len(keys)


def test_clusters_share_no_key():
    assert not set(all_keys("one").values()) & set(all_keys("other").values())


def test_all_keys_lie_below_the_root_and_the_cluster():
    assert all(key.startswith(f"{PREFIX}/c1/") for key in all_keys().values())


def test_zenoh_takes_them_as_they_are():
    for key in all_keys().values():
        assert str(zenoh.KeyExpr(key)) == key


def matching(pattern):
    return {name for name, key in all_keys().items() if zenoh.KeyExpr(pattern).intersects(zenoh.KeyExpr(key))}


def test_patterns_match_what_they_are_for_and_nothing_else():
    keys = Keys("c1")
    assert matching(keys.any_node) == {("node", 0), ("node", 1), ("node", 12)}
    assert matching(keys.any_stats) == {("stats", 0), ("stats", 1), ("stats", 12)}
    assert matching(keys.any_life) == {("life", *each) for each in itertools.product((0, 1, 12), NAMES["process"])}
    assert matching(keys.any_spy_life) == {("spy_life", process) for process in NAMES["process"]}
    assert matching(keys.any_request) == {("requests", *each) for each in itertools.product(CLIENTS, RIGHTS)}
    assert matching(keys.any_host) == {("host", host) for host in HOSTS}
    assert matching(keys.every_control) == {("control", 0), ("control", 1), ("control", 12)}


@pytest.mark.parametrize("cluster", ["c1", "spy", "node", "life"])
def test_a_token_says_whose_life_it_is_and_by_which_process(cluster):
    keys = Keys(cluster)
    for process, number, host in ((4711, 4711, ""), ("4711-h1", 4711, "h1"), ("1-a-host", 1, "a-host")):
        for token, whose in ((keys.life(12, process), 12), (keys.spy_life(process), None)):
            assert Keys.life_of(token) == (whose, number)
            assert Keys.host_of_life(token) == host


@pytest.mark.parametrize(
    "token",
    [
        "",
        "supernode/c1/node/12/life/x",
        "supernode/c1/node/x/life/4711",
        "supernode/c1/node/-1/life/4711",
        "supernode/c1/node/²/life/4711",
        "supernode/c1/node/12/life/",
        "supernode/c1/node/12/life/4711x",
        "supernode/c1/node/12/life/" + "1" * 5000,
        "supernode/c1/spy/life/-h1",
        "supernode/c1/other/life/4711",
        "supernode/c1/node/12",
        "4711",
    ],
)
def test_a_token_of_no_process_is_rejected(token):
    with pytest.raises(Rejected, match="no such life"):
        Keys.life_of(token)


def test_the_keys_of_the_protocol():
    keys = Keys("c1")
    assert keys.node(7) == "supernode/c1/node/7"
    assert keys.out(7) == "supernode/c1/node/7/out"
    assert keys.control(7) == "supernode/c1/node/7/control"
    assert keys.stats(7) == "supernode/c1/node/7/stats"
    assert keys.life(7, 4711) == "supernode/c1/node/7/life/4711"
    assert keys.life(7, "4711-h1") == "supernode/c1/node/7/life/4711-h1"
    assert keys.spy_life(4711) == "supernode/c1/spy/life/4711"
    assert keys.best == "supernode/c1/best"
    assert keys.log == "supernode/c1/log"
    assert keys.requests("anna", "watch") == "supernode/c1/jobs/anna/watch"
    assert Keys.asker_of("supernode/*/jobs/anna/watch") == ("anna", "watch")
    assert keys.any_request == "supernode/c1/jobs/*/*"
    assert keys.state == "supernode/c1/state"
