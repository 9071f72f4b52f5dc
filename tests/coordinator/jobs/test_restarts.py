"""Runs that stall without reaching their target begin anew: on real processes, each repeated bit for bit."""

import time
from pathlib import Path

import pytest
from epochs import States, again, turns_of
from stubborn import stubborn_file

import supernode
from coordinator.jobs.job import BegunAnew
from node.replay import epochs_of
from supernode.runs.simulation import Listener, Simulation

FUNCTION = """
kind = "function"
name = "rastrigin"
dimension = 6
"""
ROOT = Path(__file__).resolve().parents[3]
SAME = (
    "status",
    "feasible",
    "fitness",
    "solution",
    "best_attempt",
    "found_at",
    "generations",
    "evaluations",
    "directives",
)


@pytest.fixture(scope="module")
def cluster():
    with supernode.LocalCluster(torus=(2, 3)) as cluster:
        yield cluster


@pytest.fixture
def states(cluster):
    watched = cluster._dispatcher.hooks = States()
    return watched


@pytest.fixture
def stubborn(tmp_path):
    def write(**fields):
        return supernode.load(stubborn_file(tmp_path, **fields))

    return write


@pytest.fixture
def function(tmp_path):
    path = tmp_path / "function.toml"
    path.write_text(FUNCTION)
    return supernode.load(path)


def simulated(file, **run):
    return Simulation(epochs_of(file.with_run(**run))).run()


class Historian(Listener):
    """Keeps the improvements of all epochs."""

    def __init__(self):
        self.records = []

    def lived(self, epoch, records):
        self.records += records


def test_improvements_of_all_attempts_are_those_of_the_simulation(cluster, stubborn):
    file, historian = stubborn().with_run(topology="torus 2x3", stall=25), Historian()
    Simulation(epochs_of(file), listener=historian).run()
    job = cluster.submit(file)
    result = job.result(timeout=60)
    assert job.history() == historian.records
    assert {record.epoch for record in job.history()} == {0, 1, 2}
    spent = [record.evaluations for record in job.history()]
    assert spent == sorted(spent), "evaluations go on from attempt to attempt"
    assert spent[-1] <= result.evaluations


def both(cluster, file, **run):
    """The result of processes, which must be that of the simulator, also when it is repeated."""
    run = {"topology": "torus 2x3", **run}
    result, alone = cluster.submit(file, **run).result(timeout=60), simulated(file, **run)
    for name in (*SAME, "history_sha256", "run", "seed", "problem_sha256"):
        assert getattr(result, name) == getattr(alone, name), name
    assert result.history_sha256 == again(file, result)
    return result


@pytest.mark.parametrize(
    "run",
    [{}, {"deme": 4, "interval": 2}, {"spy": "root", "topology": "ring 5", "seed": 7}, {"mutation": "one-bit"}],
    ids=str,
)
def test_it_begins_anew_with_what_the_problem_changes(cluster, stubborn, run):
    file = stubborn()
    result = both(cluster, file, stall=25, **run)
    assert result.status == "solved"
    assert turns_of(result) == [("retry", 1), ("retry", 2)]
    first, second = result.directives
    assert (first["attempt"], first["fields"]) == (1, {"size": 24, "hurdles": 1})
    assert (second["attempt"], second["fields"]) == (2, {"size": 32, "hurdles": 0})
    assert result.found_at["epoch"] == 2
    assert result.generations > first["generation"] + second["generation"] >= 50
    assert result.problem_sha256 == file.sha256, "it is the same problem"
    assert result.messages["lost"] == result.messages["rejected"] == 0


def test_an_attempt_is_a_run_of_its_own_with_the_seed_that_is_told(cluster, stubborn):
    result = both(cluster, stubborn(), stall=25)
    last = result.directives[-1]
    alone = simulated(stubborn(**last["fields"]), topology="torus 2x3", stall=25, seed=last["seed"])
    assert (alone.status, alone.directives) == ("solved", [])
    assert alone.generations == result.generations - sum(each["generation"] for each in result.directives)
    assert alone.found_at == {name: result.found_at[name] for name in ("cell", "generation")}


def test_zero_restarts_are_none(cluster, stubborn):
    result = both(cluster, stubborn(), stall=25, restarts=0)
    assert (result.status, result.directives) == ("stalled", [])


def test_the_last_of_so_many_restarts_ends_the_run_when_it_stalls(cluster, stubborn):
    result = both(cluster, stubborn(hurdles=9), stall=25, restarts=1)
    assert (result.status, result.feasible) == ("stalled", False)
    assert turns_of(result) == [("retry", 1)]


def test_without_a_limit_an_unsolvable_problem_is_given_up_in_the_end(cluster, stubborn):
    result = both(cluster, stubborn(hurdles=99), stall=25)
    assert result.status == "stalled"
    assert [each["attempt"] for each in result.directives] == [1, 2, 3, 4, 5, 6, 7, 8]


def test_a_problem_may_give_up_earlier(cluster, stubborn):
    result = both(cluster, stubborn(hurdles=9, gives_up=3), stall=25)
    assert (result.status, len(result.directives)) == ("stalled", 2)


def test_any_kind_begins_anew_if_restarts_are_asked_for(cluster, function):
    result = both(cluster, function, stall=25, target=-1.0, restarts=2)
    assert (result.status, result.directives[-1]["fields"]) == ("stalled", {})
    assert turns_of(result) == [("retry", 1), ("retry", 2)]
    assert both(cluster, function, stall=25, target=-1.0).directives == []


def test_the_best_of_an_earlier_attempt_is_kept(cluster, stubborn):
    file = stubborn(size=8, answers='{"size": 200, "hurdles": 50}')
    result = both(cluster, file, stall=25, restarts=2)
    assert (result.status, result.fitness) == ("stalled", 2.0)
    assert result.found_at.keys() == {"cell", "generation"}, "of the first epoch"
    assert file.problem().check(result.best_attempt).fitness == 2.0


def test_limits_are_those_of_all_attempts_together(cluster, stubborn):
    file = stubborn(hurdles=99)
    result = both(cluster, file, stall=25, generations=150)
    assert (result.status, result.generations) == ("exhausted", 150)
    assert len(result.directives) > 1
    result = both(cluster, file, stall=25, evaluations=7000)
    assert result.status == "exhausted"
    assert 7000 - 6 * 8 < result.evaluations <= 7000
    assert len(result.directives) > 1


def test_no_attempt_begins_that_would_not_get_a_generation(cluster, stubborn):
    file = stubborn(hurdles=99)
    one = both(cluster, file, stall=25, restarts=0)
    result = both(cluster, file, stall=25, evaluations=one.evaluations + 6 + 6 * 8 - 1)
    assert (result.status, result.evaluations, result.directives) == ("exhausted", one.evaluations, [])
    result = both(cluster, file, stall=25, evaluations=one.evaluations + 6 + 6 * 8)
    assert (result.status, len(result.directives)) == ("exhausted", 1)


def test_a_stall_never_ends_a_run_that_something_else_limits(cluster, stubborn):
    """But it ends an attempt, for as long as there is another one."""
    result = both(cluster, stubborn(hurdles=99, gives_up=2), generations=2000)
    assert (result.status, result.generations, len(result.directives)) == ("exhausted", 2000, 1)
    assert 200 < result.directives[0]["generation"] < 300


def test_until_the_deadline_it_begins_anew_as_often_as_it_stalls(cluster, stubborn):
    file = stubborn(hurdles=1_000_000, grows=0)  # each attempt takes one of them: a quick machine takes 99 in 2 s
    submitted = time.monotonic()
    result = cluster.submit(file, seconds=4.0, stall=10).result(timeout=60)
    lasted = time.monotonic() - submitted
    assert result.status == "deadline"
    retries = [each for each in result.directives if each["do"] == "retry"]
    stops = result.directives[len(retries) :]  # none if the last attempt stalls by itself at the deadline
    assert len(retries) > 8
    assert [each["attempt"] for each in retries] == list(range(1, len(retries) + 1))
    assert [(each["do"], each["reason"]) for each in stops] in ([("stop", "deadline")], [])
    assert result.history_sha256 == again(file, result)
    assert lasted >= 4.0


def test_cancelling_ends_the_attempt_that_runs(cluster, stubborn):
    job = cluster.submit(stubborn(hurdles=99, grows=0), stall=10, seconds=60.0)
    begun = [each for each, _ in zip((e for e in job.events() if isinstance(e, BegunAnew)), range(3), strict=False)]
    assert [each.why["attempt"] for each in begun] == [1, 2, 3]
    job.cancel()
    result = job.result(timeout=60)
    assert result.status == "cancelled"
    assert result.history_sha256 == again(stubborn(hurdles=99, grows=0), result)


def test_async_attempts_follow_each_other_too(cluster, stubborn):
    result = cluster.submit(stubborn(), mode="async", stall=200).result(timeout=60)
    assert (result.status, result.found_at["epoch"]) == ("solved", 2)
    assert turns_of(result) == [("retry", 1), ("retry", 2)]
    alone = simulated(stubborn(), mode="async", stall=25, topology="torus 2x3")
    assert (alone.status, len(alone.directives)) == ("solved", 2)


def test_an_update_goes_on_from_the_attempt_and_counts_anew(cluster, states, stubborn):
    """The individuals live on as they are coded by then."""
    file = stubborn(hurdles=99, size=16)
    job = cluster.submit(file, stall=40, seconds=60.0, topology="torus 2x3")
    attempts = (event for event in job.events() if isinstance(event, BegunAnew))
    next(attempts)
    epoch = job.update(hurdles=2)
    next(event for event in attempts if event.why["attempt"] == 1)
    result = job.result(timeout=60)
    assert result.status == "solved"
    (update,) = [each for each in result.directives if each["do"] == "update"]
    assert update["epoch"] == epoch
    after = [each["attempt"] for each in result.directives if each["do"] == "retry" and each["epoch"] > epoch]
    assert after[0] == 1
    assert result.problem_sha256 == file.changed({"hurdles": 2}, {}).sha256
    assert result.history_sha256 == again(file, result)


# Kept alive -----------------------------------------------------------------------------------------------------------
def test_what_is_kept_alive_searches_until_it_has_an_answer_and_then_waits(cluster, states, stubborn):
    file = stubborn(hurdles=3)
    job = cluster.submit(file, keep_alive=True, stall=25, topology="torus 2x3")
    states.wait(job, "waiting")
    assert states.of(job) == ["queued", "preparing", "running", *["searching"] * 3, "waiting"]
    assert job.update(hurdles=1) == 4
    states.wait(job, "waiting", times=2)
    assert states.of(job)[7:] == ["running", "searching", "waiting"]
    job.cancel()
    result = job.result(timeout=60)
    assert (result.status, result.feasible, result.fitness) == ("cancelled", True, 0.0)
    assert [do for do, _ in turns_of(result)] == ["retry"] * 3 + ["update", "retry"]
    assert result.history_sha256 == again(file, result)


def test_it_searches_without_bound(cluster, states, stubborn):
    file = stubborn(hurdles=99, gives_up=3)
    job = cluster.submit(file, keep_alive=True, stall=10, restarts=1)
    states.wait(job, "searching", times=12)
    job.cancel()
    result = job.result(timeout=60)
    assert (result.status, result.feasible) == ("cancelled", False)
    retries = [each for each in result.directives if each["do"] == "retry"]
    assert [each["attempt"] for each in retries] == list(range(1, len(retries) + 1))
    assert retries[-1]["fields"] == {}, "the problem has no more ideas"
    assert result.history_sha256 == again(file, result)


def test_it_may_be_rewired_while_it_searches(cluster, states, stubborn):
    file = stubborn(hurdles=4, grows=0)
    job = cluster.submit(file, keep_alive=True, stall=40, topology="torus 2x3")
    states.wait(job, "searching")
    job.rewire("ring 6")
    states.wait(job, "waiting")
    job.cancel()
    result = job.result(timeout=60)
    assert (result.topology, result.fitness) == ("ring 6", 0.0)
    assert result.history_sha256 == again(file, result)


def test_what_has_no_target_waits_with_a_feasible_answer(cluster, states):
    file = supernode.load(ROOT / "examples" / "terrain-map.toml")
    job = cluster.submit(file, keep_alive=True, topology="torus 2x3", deme=4)
    states.wait(job, "waiting", timeout=100)
    assert "searching" not in states.of(job)
    job.cancel()
    assert job.result(timeout=60).feasible


def test_the_deadline_ends_a_search(cluster, states, stubborn):
    job = cluster.submit(stubborn(hurdles=99), keep_alive=True, stall=10, seconds=1.5)
    result = job.result(timeout=60)
    assert result.status == "deadline"
    assert {"searching", "deadline"} <= set(states.of(job))
    assert "waiting" not in states.of(job)


# What a problem may answer --------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ("3", "stubborn_module:Stubborn: next_attempt must return a table of named values, got 3"),
        ("{", "stubborn_module:Stubborn: next_attempt raised JSONDecodeError: "),
    ],
)
def test_an_answer_that_is_none_is_refused_before_the_run(cluster, stubborn, answer, said):
    file = stubborn(answers=answer)
    with pytest.raises(supernode.BadInput, match=said):
        cluster.submit(file, stall=25).result(timeout=60)
    with pytest.raises(supernode.BadInput, match=said):
        simulated(file, stall=25)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ('{"size": "large"}', "stubborn.toml: size: expected a valid integer"),
        ('{"sise": 3}', "stubborn.toml: sise: unknown field"),
        ('{"kind": "terrain"}', "stubborn.toml: next_attempt: expected fields of the problem, found kind"),
    ],
)
def test_an_attempt_that_cannot_be_fails_the_run_with_what_was_found(cluster, stubborn, answer, said):
    result = cluster.submit(stubborn(answers=answer), stall=25).result(timeout=60)
    assert result.status == "failed"
    assert said in result.message
    assert 2.0 <= result.fitness < 8.0
    again_well = cluster.submit(stubborn(hurdles=0), stall=25).result(timeout=60)
    assert again_well.status == "solved", "the cluster lives on"
