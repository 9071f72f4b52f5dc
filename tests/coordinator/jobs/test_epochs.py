"""Several jobs at once, and jobs that live in several epochs: on real processes, each repeated bit for bit."""

import itertools
import math

import pytest
from epochs import States, again, best_again, turns_of

import supernode
from coordinator.jobs.job import JobSpec
from node.replay import replay
from spy.improvement_records import records_of
from spy.past import Lived, Past
from wire import control
from wire.callbacks import direct
from wire.news import Improvement
from wire.seal import Seal

FUNCTION = """
kind = "function"
name = "rastrigin"
dimension = 6
"""
ENDLESS = {"target": -1.0, "stall": 10**9}
ROOM = """
kind = "mobile-robot"
start = [1.0, 1.0, 0.0]
goal = [9.0, 9.0, 0.0]
commands = 6
bits = 8
bounds = [0.0, 0.0, 10.0, 10.0]

[robot]
radius = 0.3

[[obstacles]]
shape = "box"
center = [5.0, 5.0]
size = [2.0, 2.0]
"""


@pytest.fixture(scope="module")
def shared():
    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        yield cluster


@pytest.fixture
def cluster(shared):
    """A cluster without jobs; those that a test leaves behind end with it."""
    yield shared
    for job in list(shared._dispatcher.jobs.values()):
        job.cancel()
        job.result(timeout=60)


@pytest.fixture
def states(cluster):
    """What becomes of the jobs of a test."""
    watched = cluster._dispatcher.hooks = States()
    return watched


@pytest.fixture
def function(tmp_path):
    path = tmp_path / "function.toml"
    path.write_text(FUNCTION)
    return supernode.load(path)


@pytest.fixture
def room(tmp_path):
    path = tmp_path / "room.toml"
    path.write_text(ROOM)
    return supernode.load(path)


def next_of_epoch(improvements, epoch):
    """Wait for an answer in an epoch; there is none for an older one after it."""
    for better in improvements:
        if better.epoch >= epoch:
            return better
    raise AssertionError(f"the job ended before there was an answer in epoch {epoch}")


def cancelled(job):
    job.cancel()
    result = job.result(timeout=60)
    assert result.status == "cancelled"
    assert result.messages["lost"] == result.messages["rejected"] == 0
    return result


def test_what_was_found_stays_the_answer_when_the_nodes_are_rewired(cluster, function):
    """Offspring replace their parents, however good these were."""
    job = cluster.submit(function, topology="torus 4x4", replacement="offspring", seed=3, **ENDLESS)
    improvements = job.improvements()
    found = [next(improvements) for _ in range(4)]
    for topology in ("ring 16", "complete 16", "torus 4x4"):
        job.rewire(topology)
    result = cancelled(job)
    found += improvements
    ranks = [(better.epoch, -better.fitness) for better in found]
    assert ranks == sorted(ranks)
    assert sorted((better.fitness for better in found), reverse=True) == [better.fitness for better in found]
    assert {better.epoch for better in found} == {0, 1, 2, 3}, "it is an answer in each"
    assert result.fitness <= found[-1].fitness
    assert result.history_sha256 == again(function, result)
    assert result.fitness == best_again(function, result).fitness


def begun_before(file, number):
    """A job that has lost its nodes in its second epoch."""
    past = Past().and_then(Lived(file), {"do": "rewire", "topology": "ring 16"})
    past = past.and_then(Lived(file.with_run(topology="ring 16"), number=1), {"do": "restart"})
    best = Improvement(number, 1, 0.1, 3, 1, 1e-9, True, {"x": [0.0] * 6, "value": 1e-9})
    return JobSpec(number, file.with_run(topology="ring 16"), past=past, best=best, first=file)


def test_a_job_that_begins_again_keeps_its_past_and_its_best_answer(cluster, function):
    spec = begun_before(function.with_run(topology="torus 4x4", generations=5, target=-1.0), 10_000)
    job = cluster._dispatcher.submit(spec)
    result = job.result(60)
    assert [each["do"] for each in result.directives] == ["rewire", "restart"]
    assert (result.status, result.fitness, result.found_at["epoch"]) == ("exhausted", 1e-9, 2)
    assert (result.run["topology"], result.topology, result.generations) == ("torus 4x4", "ring 16", 5)
    assert [better.epoch for better in job.improvements()] == [2]


def test_a_job_that_begins_again_but_never_gets_nodes_ends_with_what_it_had(cluster, function):
    busy = cluster.submit(function, **ENDLESS)
    next(busy.improvements())
    job = cluster._dispatcher.submit(begun_before(function.with_run(topology="torus 4x4"), 10_001))
    job.cancel()
    result = job.result(60)
    assert [each["do"] for each in result.directives] == ["rewire", "restart"]
    assert (result.status, result.fitness, result.feasible, result.message) == ("cancelled", 1e-9, True, None)


# Several jobs at once -------------------------------------------------------------------------------------------------
def test_four_jobs_at_once_are_each_as_if_alone(cluster, function, own_problem):
    own = supernode.load(own_problem("size = 4000"))
    orders = [
        (function, {"topology": "torus 2x2", "seed": 1}),
        (own, {"topology": "ring 4", "seed": 1, "deme": 3}),
        (function, {"topology": "complete 4", "seed": 2, "deme": 5, "interval": 2, "emigrants": 2}),
        (own, {"topology": "torus 1x4", "seed": 9, "spy": "root"}),
    ]
    jobs = [cluster.submit(file, **ENDLESS, **run) for file, run in orders]
    for job in jobs:
        next(job.improvements())  # none of them has ended, so all have nodes
    results = [cancelled(job) for job in jobs]
    for (file, run), result in zip(orders, results, strict=True):
        assert result.topology == run["topology"]
        assert result.nodes == 4
        assert result.history_sha256 == again(file, result)
        for other in {id(each): each for each in (function, own)}.values():
            assert (other.sha256 == file.sha256) == (result.problem_sha256 == other.sha256)


def test_nodes_of_a_small_job_know_how_many_they_share_the_reports_with(cluster, function):
    heard, seal = [], Seal(cluster._launcher.secret)

    def hear(query):
        heard.append(control.decode(seal.open(str(query.key_expr), query.payload.to_bytes())))
        query.drop()

    dispatcher = cluster._dispatcher
    queryable = dispatcher.session.declare_queryable(dispatcher.keys.every_control, direct(hear))
    cluster.submit(function, topology="torus 1x2", generations=3).result(timeout=60)
    queryable.undeclare()
    assert {each.cluster_nodes for each in heard if isinstance(each, control.Prepare)} == {16}


def test_jobs_that_follow_each_other_on_the_same_nodes_do_not_hear_each_other(cluster, own_problem):
    """As fast as they can: messages of the one before are still on their way when the next begins."""
    file = supernode.load(own_problem("size = 200"))
    shapes = ["torus 4x4", "ring 5", "ring 5", "torus 2x4", "complete 6", "hypercube 3", "torus 4x4", "torus 1x1"]
    jobs = [
        cluster.submit(file, topology=shape, seed=seed, generations=60, target=-1.0)
        for seed, shape in enumerate(shapes * 2)
    ]
    for job, shape in zip(jobs, shapes * 2, strict=True):
        result = job.result(timeout=60)
        assert (result.status, result.topology, result.generations) == ("exhausted", shape, 60)
        assert result.messages["lost"] == result.messages["rejected"] == 0
        assert result.history_sha256 == again(file, result)


@pytest.mark.parametrize("topology", ["ring 7", "complete 6", "grid 3x3", "moore 4x4", "random-regular 10 3 seed 1"])
def test_a_job_of_another_topology_on_the_same_cluster(cluster, function, topology):
    run = {"topology": topology, "deme": 4, "generations": 40, "target": -1.0}
    result = cluster.submit(function, **run).result(timeout=60)
    assert (result.status, result.topology) == ("exhausted", topology)
    assert result.history_sha256 == again(function, result)
    at_home = cluster.submit(function, **run | {"topology": None}).result(timeout=60)
    assert at_home.topology == "torus 4x4"
    assert at_home.history_sha256 == again(function, at_home)


def test_a_job_larger_than_the_cluster_is_refused(cluster, function):
    with pytest.raises(supernode.BadInput, match=r"asks for 81 cells \(torus 9x9\), the cluster has 16 nodes"):
        cluster.submit(function, topology="torus 9x9")


def test_jobs_queued_behind_a_large_one_keep_their_order(cluster, states, function):
    small = {"topology": "torus 2x2"} | ENDLESS
    first = cluster.submit(function, **small)
    next(first.improvements())
    large = cluster.submit(function, **ENDLESS)
    behind = [cluster.submit(function, **ENDLESS, seed=1), cluster.submit(function, **small, seed=2)]
    states.wait(behind[1], "queued")
    assert [states.of(job) for job in (large, *behind)] == [["queued"]] * 3, "twelve nodes are free, and wait for it"
    cancelled(first)
    next(large.improvements())
    assert [states.of(job) for job in behind] == [["queued"]] * 2
    cancelled(large)
    next(behind[0].improvements())
    assert states.of(behind[1]) == ["queued"]
    results = [cancelled(behind[0])]
    next(behind[1].improvements())
    results.append(cancelled(behind[1]))
    assert states.order_of("preparing", [first, large, *behind]) == [0, 1, 2, 3]
    assert all(result.history_sha256 == again(function, result) for result in results)


def test_a_job_that_is_cancelled_while_it_is_queued_never_runs(cluster, states, function):
    large = cluster.submit(function, **ENDLESS)
    queued, next_one = (cluster.submit(function, generations=3, target=-1.0, seed=seed) for seed in (1, 2))
    next(large.improvements())
    queued.cancel()
    result = queued.result(timeout=60)
    assert (result.status, result.generations, result.evaluations) == ("cancelled", 0, 0)
    assert math.isinf(result.fitness)
    assert "running" not in states.of(queued)
    cancelled(large)
    assert next_one.result(timeout=60).history_sha256 == again(function, next_one.result())


# Several epochs -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "run", [{}, {"deme": 5, "interval": 3, "emigrants": 2}, {"spy": "root", "topology": "ring 5"}], ids=str
)
def test_an_update_while_it_runs(cluster, function, run):
    job = cluster.submit(function, **ENDLESS, **run)
    improvements = job.improvements()
    assert next(improvements).epoch == 0
    assert job.update(name="sphere") == 1
    better = next_of_epoch(improvements, 1)
    x = better.solution["x"]
    assert better.fitness == pytest.approx(sum(each * each for each in x)), "it is an answer for the new world"
    result = cancelled(job)
    assert turns_of(result) == [("update", 1)]
    assert result.directives[0]["fields"] == {"name": "sphere"}
    assert result.found_at["epoch"] == 1
    assert result.history_sha256 == again(function, result)
    assert result.problem_sha256 == function.changed({"name": "sphere"}, {}).sha256


def test_the_individuals_of_the_old_epoch_live_on_in_the_new_one(cluster, function):
    """An update that changes nothing loses nothing."""
    job = cluster.submit(function, **ENDLESS, deme=8, replacement="elitist")
    improvements = job.improvements()
    best = min(better.fitness for better in itertools.islice(improvements, 8))
    assert job.update(cost_us=0) == 1
    better = next_of_epoch(improvements, 1)
    assert better.epoch == 1
    assert better.fitness <= best, "what the cells had"
    result = cancelled(job)
    assert result.history_sha256 == again(function, result)


def test_a_change_that_changes_nothing_makes_no_epoch(cluster, function):
    """As when a client repeats what it has had no answer to."""
    job = cluster.submit(function, **ENDLESS)
    assert [job.update(name="sphere"), job.update(name="sphere"), job.rewire("ring 16"), job.rewire("ring 16")] == [
        1,
        1,
        2,
        2,
    ]
    assert turns_of(cancelled(job)) == [("update", 1), ("rewire", 2)]


def test_a_rewiring_while_it_runs(cluster, function):
    job = cluster.submit(function, **ENDLESS)
    next(job.improvements())
    assert job.rewire("ring 16") == 1
    assert job.rewire("moore 4x4") == 2
    result = cancelled(job)
    assert turns_of(result) == [("rewire", 1), ("rewire", 2)]
    assert (result.topology, result.run["topology"]) == ("moore 4x4", "torus 4x4")
    assert result.history_sha256 == again(function, result)
    plain = cluster.submit(function, generations=20, target=-1.0).result(timeout=60)
    assert plain.history_sha256 == again(function, plain), "the next job finds the links that it wants"


def test_many_changes_in_a_row_while_another_job_runs(cluster, function):
    run = {"topology": "torus 2x4", "deme": 2} | ENDLESS
    jobs = [cluster.submit(function, **run, seed=seed) for seed in (1, 2)]
    for job in jobs:
        next(job.improvements())
    for turn, topology in enumerate(("ring 8", "hypercube 3", "ring 8")):
        for job in jobs:
            assert job.update(name="rastrigin" if turn % 2 else "sphere") == 2 * turn + 1
            assert job.rewire(topology) == 2 * turn + 2
    for job in jobs:
        result = cancelled(job)
        assert [epoch for _, epoch in turns_of(result)] == [1, 2, 3, 4, 5, 6]
        assert result.history_sha256 == again(function, result)
        assert result.generations == sum(each["generation"] for each in result.directives)


def test_an_update_may_come_before_all_cells_have_begun(cluster, states, function):
    for seed in range(30):
        job = cluster.submit(function, **ENDLESS, seed=seed)
        states.wait(job, "running")
        assert job.update(name="sphere") == 1
        result = cancelled(job)
        assert turns_of(result) == [("update", 1)]
        assert result.history_sha256 == again(function, result)


def test_a_limit_of_generations_is_one_of_the_job_and_not_of_an_epoch(cluster, states, function):
    job = cluster.submit(function, target=-1.0, generations=3000, topology="torus 2x2")
    states.wait(job, "running")
    assert job.update(name="sphere") == 1
    result = job.result(timeout=60)
    assert (result.status, result.generations) == ("exhausted", 3000)
    assert result.history_sha256 == again(function, result)


def test_an_update_of_a_users_own_problem(cluster, own_problem):
    file = supernode.load(own_problem("size = 4000"))
    job = cluster.submit(file, **ENDLESS, topology="torus 2x2")
    improvements = job.improvements()
    next(improvements)
    assert job.update(trouble="none that it knows") == 1
    next_of_epoch(improvements, 1)
    result = cancelled(job)
    assert result.history_sha256 == again(file, result)


def test_async_epochs_follow_each_other_too(cluster, states, function):
    job = cluster.submit(function, mode="async", target=-1.0, generations=10_000)
    states.wait(job, "running")
    improvements = job.improvements()
    assert job.update(name="sphere") == 1
    assert next_of_epoch(improvements, 1).epoch == 1
    assert job.rewire("ring 16") == 2
    result = job.result(timeout=60)
    assert (result.status, result.topology) == ("exhausted", "ring 16"), "each cell lives for as long as it may"
    assert turns_of(result) == [("update", 1), ("rewire", 2)]


# What is refused ------------------------------------------------------------------------------------------------------
def test_what_cannot_be_is_refused_and_the_job_goes_on(cluster, room):
    job = cluster.submit(room, **ENDLESS, deme=4)
    improvements = job.improvements()
    next(improvements)
    refused = [
        ({"start": [5.0, 5.0, 0.0]}, r"^update of .*room.toml: start: .*"),
        ({"commands": 7}, "room.toml: the update would change how individuals are coded; submit another job instead"),
        ({"strat": [1.0, 1.0, 0.0]}, r"^update of .*room.toml: strat: unknown field"),
        ({"kind": "terrain"}, r"^update of .*room.toml: kind: expected 'mobile-robot' as before"),
        ({"run": {"deme": 2}}, r"^update of .*room.toml: run: "),
        ({"goal": "home"}, r"^update of .*room.toml: goal: "),
    ]
    for fields, said in refused:
        with pytest.raises(supernode.BadInput, match=said):
            job.update(**fields)
    for topology, said in (("ring 7", "expected one of 16 cells, found 'ring 7'"), ("circle 16", "topology: ")):
        with pytest.raises(supernode.BadInput, match=said):
            job.rewire(topology)
    assert job.update(goal=[9.0, 1.0, 0.0]) == 1, "the first that there is"
    assert next_of_epoch(improvements, 1).epoch == 1
    result = cancelled(job)
    assert turns_of(result) == [("update", 1)]
    assert result.history_sha256 == again(room, result)


def test_an_update_of_a_users_own_problem_that_codes_otherwise_is_refused_too(cluster, own_problem):
    file = supernode.load(own_problem("size = 4000"))
    job = cluster.submit(file, **ENDLESS)
    improvements = job.improvements()
    next(improvements)
    with pytest.raises(supernode.BadInput, match="the update would change how individuals are coded"):
        job.update(size=4008)
    with pytest.raises(supernode.BadInput, match=r"^update of .*own.toml: size: "):
        job.update(size="large")
    assert job.update(trouble="none that it knows") == 1
    result = cancelled(job)
    assert turns_of(result) == [("update", 1)]
    assert result.history_sha256 == again(file, result)


def test_a_problem_that_breaks_in_a_later_epoch_fails_the_job_and_not_the_cluster(cluster, own_problem):
    file = supernode.load(own_problem("size = 400"))
    job = cluster.submit(file, **ENDLESS)
    next(job.improvements())
    assert job.update(trouble="raises") == 1
    result = job.result(timeout=60)
    assert (result.status, result.history_sha256) == ("failed", None)
    assert "evaluate raised RuntimeError: out of paper" in result.message
    sound = cluster.submit(file, generations=20, target=-1.0).result(timeout=60)
    assert sound.history_sha256 == again(file, sound)


def test_a_job_that_has_ended_has_no_further_epoch(cluster, function):
    job = cluster.submit(function, generations=1, target=-1.0)
    job.result(timeout=60)
    for change in (lambda: job.update(name="sphere"), lambda: job.rewire("ring 16")):
        with pytest.raises(supernode.ClusterFailed, match="has ended"):
            change()


def test_a_job_that_is_being_stopped_has_no_further_epoch(cluster, function):
    job = cluster.submit(function, **ENDLESS)
    next(job.improvements())
    job.cancel()
    with pytest.raises(supernode.ClusterFailed, match=r"is being stopped|has ended"):
        job.update(name="sphere")
    assert turns_of(job.result(timeout=60)) == []


# Kept alive -----------------------------------------------------------------------------------------------------------
def test_a_job_that_is_kept_alive_goes_on_from_its_answer(cluster, states, room):
    job = cluster.submit(room, keep_alive=True, deme=8)
    goals = [[9.0, 1.0, 0.0], [1.0, 9.0, 0.0]]
    for epoch, goal in enumerate(goals, 1):
        states.wait(job, "waiting", times=epoch)
        with pytest.raises(supernode.BadInput, match="start"):
            job.update(start=[5.0, 5.0, 0.0])
        assert job.update(goal=goal) == epoch
    states.wait(job, "waiting", times=3)
    result = cancelled(job)
    assert (result.solved, result.feasible, result.found_at["epoch"]) == (False, True, 2)
    assert result.fitness <= result.target
    assert states.of(job) == ["queued", "preparing", "running", *["waiting", "running"] * 2, "waiting"]
    assert turns_of(result) == [("update", 1), ("update", 2)]
    assert result.history_sha256 == again(room, result)
    end = result.solution["path"][-1] if "path" in result.solution else None
    assert end is None or math.dist(end[:2], goals[-1][:2]) < 1.0


def test_a_job_that_is_kept_alive_can_be_rewired_while_it_waits(cluster, states, function):
    job = cluster.submit(function, keep_alive=True, target=1e9)
    states.wait(job, "waiting")
    assert job.rewire("ring 16") == 1
    states.wait(job, "waiting", times=2)
    result = cancelled(job)
    assert result.history_sha256 == again(function, result)


@pytest.mark.parametrize("limit", [{"generations": 30}, {"evaluations": 1000}], ids=str)
def test_a_job_that_is_kept_alive_ends_when_its_limit_is_used_up(cluster, states, function, limit):
    """Nothing could go on in another epoch."""
    job = cluster.submit(function, keep_alive=True, target=-1.0, **limit)
    result = job.result(timeout=60)
    assert result.status == "exhausted"
    assert states.of(job) == ["queued", "preparing", "running"], "and never waits"
    solved = cluster.submit(function, keep_alive=True, target=1e9, **limit)
    states.wait(solved, "waiting")
    solved.cancel()
    assert solved.result(timeout=60).status == "cancelled"


def test_the_deadline_of_a_job_that_is_kept_alive(cluster, states, function):
    job = cluster.submit(function, keep_alive=True, target=1e9, seconds=3)
    states.wait(job, "waiting")
    assert job.update(name="sphere") == 1
    result = job.result(timeout=60)
    assert result.status == "deadline"
    assert result.seconds >= 2
    assert states.of(job)[-1] in ("waiting", "deadline")
    assert turns_of(result) == [("update", 1)]
    assert result.history_sha256 == again(function, result)


def test_nodes_of_a_job_that_waits_are_not_given_to_others(cluster, states, function):
    kept = cluster.submit(function, keep_alive=True, target=1e9, topology="torus 2x2")
    states.wait(kept, "waiting")
    large = cluster.submit(function, generations=5, target=-1.0)
    small = cluster.submit(function, generations=5, target=-1.0, topology="torus 2x2")
    assert kept.update(name="sphere") == 1
    states.wait(kept, "waiting", times=2)
    assert states.of(large) == states.of(small) == ["queued"]
    result = cancelled(kept)
    assert result.history_sha256 == again(function, result)
    for job in (large, small):
        assert job.result(timeout=60).history_sha256 == again(function, job.result())


def test_closing_the_cluster_fails_a_job_that_waits(function):
    cluster = supernode.LocalCluster(torus=(1, 2))
    watched = cluster._dispatcher.hooks = States()
    job = cluster.submit(function, keep_alive=True, target=1e9)
    watched.wait(job, "waiting")
    cluster.close()
    assert job.result(timeout=10).message == "the cluster was closed"
    with pytest.raises(supernode.ClusterFailed, match="has ended"):
        job.update(name="sphere")


def test_the_run_log_tells_of_each_epoch(cluster, states, function, tmp_path):
    import json

    log = tmp_path / "run.jsonl"
    job = cluster.submit(function, keep_alive=True, target=1e9, log=str(log))
    states.wait(job, "waiting")
    job.update(name="sphere")
    states.wait(job, "waiting", times=2)
    cancelled(job)
    events = [json.loads(line) for line in log.read_text().splitlines()]
    told = [(each["event"], each.get("epoch")) for each in events if each["event"] in ("start", "improvement", "end")]
    assert [event for event, _ in told if event != "improvement"] == ["start", "end", "start", "end"]
    assert [epoch for event, epoch in told if event == "start"] == [0, 1]
    assert {epoch for event, epoch in told if event == "improvement"} == {0, 1}
    assert {record.epoch for record in job.history()} == {0, 1}
    assert told.index(("improvement", 0)) < told.index(("start", 1)), "an epoch's improvements come when it has ended"


def test_improvements_of_a_job_with_updates_are_those_of_its_replay(cluster, states, function, tmp_path):
    job = cluster.submit(function, keep_alive=True, target=1e9, seed=5)
    states.wait(job, "waiting")
    job.update(name="sphere")
    states.wait(job, "waiting", times=2)
    result = cancelled(job)
    past, again = Past(), []
    lived = replay(function.with_run(**result.run), result.directives)
    for each, after in itertools.zip_longest(lived, lived[1:]):
        epoch = Lived(each.file, each.reports, each.plan.epoch)
        again += records_of(past, epoch)
        past = past.and_then(epoch, None if after is None else after.why)
    assert job.history() == again
