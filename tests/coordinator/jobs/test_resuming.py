"""A job goes on from a checkpoint on processes that know nothing of it: in lockstep as if it had never ended."""

import os
import random
import signal
from dataclasses import replace

import pytest
from epochs import States, again, turns_of
from hypothesis import given
from hypothesis import strategies as st
from one_max import AskingBus, plan_of
from stubborn import stubborn_file

import supernode
import topologies
from coordinator.jobs.checkpoint import Checkpoint
from coordinator.jobs.checkpointing import consistent_states
from coordinator.jobs.resuming import donor_of
from coordinator.store.checkpoint_folder import CheckpointFolder
from node.cell import Cell
from node.events import Start
from node.simulation import simulate
from problems.file import parse
from wire.takeover import Takeover

SAME = ("status", "fitness", "history_sha256", "generations", "evaluations", "found_at", "directives", "topology")


class Interrupted(AskingBus):
    """A bus on which all cells die at some moments, and others go on from what they kept of each other then."""

    def __init__(self, plan, source, steps):
        super().__init__(plan, source)
        self.steps = steps
        self.resumed = 0

    def run(self):
        for steps in self.steps:
            for _ in range(steps):
                self.one_step()
            self.die()
        return super().run()

    def states(self):
        self.ask_for_states(range(len(self.cells)), once=True)
        return consistent_states(self.kept.values(), len(self.cells), self.cells[0].plan.run.mode)

    def die(self):
        states, plan = self.states(), self.cells[0].plan
        if not states or self.reports:
            return
        self.resumed += 1
        self.cells = [Cell(plan, number, job=1) for number in range(len(self.cells))]
        self.news = [[] for _ in self.cells]
        self.events = [[Start(takeover=Takeover(*each, others_wait=False))] for each in states]


@pytest.mark.parametrize("topology", ["torus 3x4", "torus 1x2", "ring 7"])
@pytest.mark.parametrize("settings", [{}, {"deme": 4, "emigrants": 2, "interval": 3}], ids=str)
def test_all_cells_die_again_and_again_and_nothing_changes(topology, settings):
    plan = plan_of(size=64, topology=topology, generations=120, target=-1.0, **settings)
    resumed = 0
    for seed in range(4):
        source = random.Random(seed)
        cells = plan.topology.cells
        bus = Interrupted(plan, source, [source.randrange(20 * cells, 60 * cells) for _ in range(4)])
        digests = [(report.generation, report.digest, report.births) for report in bus.run()]
        assert digests == [(report.generation, report.digest, report.births) for report in simulate(plan)]
        resumed += bus.resumed
    assert resumed >= 8


def test_states_fit_together_only_if_there_is_one_of_each_cell_in_the_same_generation():
    bus = Interrupted(plan_of(size=64, topology="ring 5", generations=100, target=-1.0), random.Random(1), [])
    assert bus.states() == ()
    for _ in range(300):
        bus.one_step()
    states = bus.states()
    assert len(states) == 5
    assert len({generation for generation, _ in states}) == 1
    told = list(bus.kept.values())
    assert len(consistent_states(told, 5, "async")) == 5
    assert consistent_states(told[1:], 5, "lockstep") == consistent_states(told[1:], 5, "async") == ()


@given(*[st.integers(1, 9)] * 4)
def test_a_torus_is_stretched_onto_another_one(rows, columns, other_rows, other_columns):
    new, old = topologies.parse(f"torus {rows}x{columns}"), topologies.parse(f"torus {other_rows}x{other_columns}")
    donors = [donor_of(cell, new, old) for cell in range(new.cells)]
    assert donors[0] == 0
    assert all(0 <= donor < old.cells for donor in donors)
    if rows >= other_rows and columns >= other_columns:
        assert set(donors) == set(range(old.cells)), "no deme is lost where there is room for all"
    if (rows, columns) == (other_rows, other_columns):
        assert donors == list(range(old.cells))


# Real processes -------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def cluster():
    with supernode.LocalCluster(torus=(3, 4)) as cluster:
        yield cluster


def function(cost=100, **run):
    text = f'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = {cost}\n'
    return parse(text, "function", "/").with_run(**{"target": -1.0} | run)


def summary(result):
    return {name: getattr(result, name) for name in SAME}


def test_a_run_goes_on_bit_for_bit(cluster, tmp_path):
    file = function(topology="torus 2x3", generations=800)
    whole = cluster.submit(file, topology="torus 2x3", checkpoints=tmp_path, checkpoint_every=0.2).result()
    checkpoint, _ = CheckpointFolder(tmp_path).latest()
    assert 0 < checkpoint.generation <= 800
    rest = cluster.resume(tmp_path).result()
    assert summary(rest) == summary(whole)
    assert rest.directives == []


def test_a_restarted_run_goes_on_in_its_last_attempt(cluster, tmp_path):
    file = supernode.load(stubborn_file(tmp_path)).with_run(topology="torus 2x3", stall=400)
    whole = cluster.submit(file, topology="torus 2x3", checkpoints=tmp_path / "run", checkpoint_every=0.01).result()
    checkpoint, _ = CheckpointFolder(tmp_path / "run").latest()
    assert checkpoint.epoch > 0
    assert summary(cluster.resume(tmp_path / "run").result()) == summary(whole)


@pytest.mark.parametrize("topology", ["torus 1x3", "torus 3x4", "ring 5"])
def test_on_another_topology_it_goes_on_with_the_demes_and_its_directives_say_how(cluster, tmp_path, topology):
    file = function(topology="torus 2x3", generations=600)
    cluster.submit(file, topology="torus 2x3", checkpoints=tmp_path, checkpoint_every=0.2).result()
    checkpoint, _ = CheckpointFolder(tmp_path).latest()
    result = cluster.resume(tmp_path, topology=topology).result()
    assert (result.status, result.generations) == ("exhausted", 600)
    assert turns_of(result) == [("resume", 1)]
    assert result.directives[0]["generation"] == checkpoint.generation
    assert again(file, result) == result.history_sha256


def test_an_async_run_goes_on_with_its_demes(cluster, tmp_path):
    file = function(topology="torus 2x3", generations=800, mode="async")
    whole = cluster.submit(file, topology="torus 2x3", checkpoints=tmp_path, checkpoint_every=0.2).result()
    result = cluster.resume(tmp_path).result()
    assert turns_of(result) == [("resume", 1)]
    assert result.fitness <= whole.fitness + 64
    assert result.generations >= 800


def test_a_run_whose_states_are_those_of_another_problem_fails_clearly(cluster, tmp_path):
    file = function(topology="torus 2x3", generations=400)
    cluster.submit(file, topology="torus 2x3", checkpoints=tmp_path, checkpoint_every=0.2).result()
    folder = CheckpointFolder(tmp_path)
    checkpoint, _ = folder.latest()
    wrong = tuple((generation, state[:-1]) for generation, state in checkpoint.states)
    folder.keep(type(checkpoint)(**vars(checkpoint) | {"states": wrong}))
    result = cluster.resume(tmp_path).result()
    assert result.status == "failed"
    assert "a cell's state has" in result.message


def test_the_job_goes_on_although_no_checkpoint_can_be_kept(cluster, tmp_path):
    (tmp_path / "file").write_text("no folder")
    file = function(topology="torus 2x3", generations=300)
    job = cluster.submit(file, topology="torus 2x3", checkpoints=tmp_path / "file" / "run", checkpoint_every=0.1)
    failed = [event.why for event in job.events() if hasattr(event, "why")]
    assert job.result().status == "exhausted"
    assert len(failed) == 1, "said once"
    assert str(tmp_path / "file") in failed[0]


def test_a_run_that_ended_before_any_state_begins_again_on_whatever_topology(cluster, tmp_path):
    file = function(topology="torus 2x3", generations=50)
    for topology in ("torus 2x3", "torus 3x4"):
        folder = tmp_path / topology  # each its own: a run that goes on may keep a state before it ends
        CheckpointFolder(folder).keep(Checkpoint(file, file))
        result = cluster.resume(folder, topology=topology).result()
        assert (result.generations, result.topology, result.directives) == (50, topology, [])
        assert again(file, result) == result.history_sha256


def test_what_is_no_topology_or_no_time_is_refused(cluster, tmp_path):
    file = function(topology="torus 2x3", generations=50)
    CheckpointFolder(tmp_path).keep(Checkpoint(file, replace(file, attempt=1), epoch=1, why={"do": "retry"}))
    with pytest.raises(supernode.BadInput, match="topology: expected torus 2x3"):
        cluster.resume(tmp_path, torus="2x2")
    with pytest.raises(supernode.BadInput, match="torus"):
        cluster.resume(tmp_path, torus="2x2x2")
    with pytest.raises(supernode.BadInput, match="checkpoint_every: expected more than 0"):
        cluster.submit(file, checkpoints=tmp_path / "other", checkpoint_every=0.0)


def test_long_generations_do_not_keep_checkpoints_from_being_made(cluster, tmp_path):
    file = function(cost=60_000, topology="torus 1x2", generations=9)  # each takes longer than the time between two
    cluster.submit(file, topology="torus 1x2", checkpoints=tmp_path, checkpoint_every=0.2).result()
    checkpoint, _ = CheckpointFolder(tmp_path).latest()
    assert checkpoint.generation >= 4


def kill_all_nodes(cluster):
    before = cluster.processes
    for name, process in before.items():
        if name.startswith("node "):
            os.kill(process, signal.SIGKILL)


def test_a_job_of_one_cell_begins_again_bit_for_bit_when_its_process_dies(tmp_path):
    file = function(cost=1000, topology="torus 1x1", generations=200)
    CheckpointFolder(tmp_path).keep(Checkpoint(file, file))
    with supernode.LocalCluster(torus=(1, 1), kinds=["function"]) as cluster:
        job = cluster.resume(tmp_path)
        next(job.improvements())
        kill_all_nodes(cluster)
        result = job.result()
    assert (result.status, result.generations, result.directives) == ("exhausted", 200, [])
    assert again(file, result) == result.history_sha256


def test_all_processes_of_a_job_that_waits_for_an_update_die(tmp_path):
    file = function(topology="torus 1x2", keep_alive=True, target=10.0)
    with supernode.LocalCluster(torus=(1, 2), kinds=["function"]) as cluster:
        states = cluster._dispatcher.hooks = States()
        job = cluster.submit(file, checkpoints=tmp_path, checkpoint_every=0.02)
        states.wait(job, "waiting")
        assert CheckpointFolder(tmp_path).latest()[0].states
        kill_all_nodes(cluster)
        states.wait(job, "waiting", times=2)
        job.cancel()
        result = job.result(60)
    assert result.fitness <= 10.0
    assert again(file, result) == result.history_sha256
