"""A user's problem whose code crashes processes: deadly individuals are infeasible; a deadly problem fails alone."""

import epochs
import pytest
from live_service import live, log_texts

import supernode
from node.replay import replay

MODULE = """
import ctypes

import numpy as np
import supernode


class Poison(supernode.Problem):
    @property
    def coding(self):
        return supernode.BitString(16, 1)

    def evaluate(self, genomes):
        if np.any(genomes[:, 0] < 64):
            ctypes.string_at(0)
        return genomes[:, 0].astype(float) + 1.0


class Hopeless(Poison):
    def for_cell(self):
        ctypes.string_at(0)
"""


@pytest.fixture
def service(tmp_path, monkeypatch):
    (tmp_path / "poison_module.py").write_text(MODULE)
    for kind in ("Poison", "Hopeless"):
        (tmp_path / f"{kind}.toml").write_text(f'kind = "poison_module:{kind}"\n[run]\ntarget = 0.0\nstall = 1000000\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with live(tmp_path / "state", "torus 2x4", "--allow-module", "poison_module") as service:
        yield service


def test_a_job_that_crashes_its_nodes_for_ever_fails_and_says_why_and_another_goes_on(service, tmp_path):
    before = service.info().process
    with service.connect() as client:
        good = tmp_path / "good.toml"
        good.write_text('kind = "function"\nname = "onemax"\ndimension = 8\n[run]\ntarget = -1.0\n')
        other = client.submit(good, topology="torus 1x4", seconds=120)
        for _ in range(2):
            result = client.submit(tmp_path / "Hopeless.toml", topology="torus 1x4").result(60)
            assert result.status == "failed"
            assert result.message == "the problem's code has crashed 25 processes, the last one by SIGSEGV"
        assert other.state() == "running"
        other.cancel()
        assert other.result(60).status == "cancelled"
    assert service.info().process == before


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_a_job_goes_on_though_a_quarter_of_all_individuals_is_deadly(service, tmp_path, mode):
    path = tmp_path / "Poison.toml"
    with service.connect() as client:
        job = client.submit(path, topology="torus 1x4", generations=30, mode=mode)
        result = job.result(120)
        texts = log_texts(client, job)
    assert (result.status, result.fitness >= 65.0) == ("exhausted", True)
    infeasible = next(each["genomes"] for each in result.directives if each["do"] == "infeasible")
    assert all(int(genome[:2], 16) < 64 for genome in infeasible)
    assert {text.split()[1] for text in texts if "counts as infeasible" in text} == set(infeasible)
    if mode == "lockstep":
        file = supernode.load(path).with_run(topology="torus 1x4", generations=30)
        assert epochs.history(replay(file, result.directives)) == result.history_sha256


FEW = """
import ctypes

import numpy as np
import supernode


class Deadly(supernode.Problem):
    @property
    def coding(self):
        return supernode.BitString(8, 1)

    def evaluate(self, genomes):
        if np.any(genomes[:, 0] == 0):
            ctypes.string_at(0)
        return genomes[:, 0].astype(float)
"""


@pytest.mark.parametrize("deme", [1, 4])
def test_a_deadly_individual_is_infeasible_and_the_run_goes_on_exactly(tmp_path, monkeypatch, deme):
    (tmp_path / "deadly_module.py").write_text(FEW)
    (tmp_path / "deadly.toml").write_text(f'kind = "deadly_module:Deadly"\n[run]\ntarget = -1.0\ndeme = {deme}\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    options = ("--allow-module", "deadly_module")
    with live(tmp_path / "state", "torus 1x3", *options) as service, service.connect() as client:
        job = client.submit(tmp_path / "deadly.toml", topology="torus 1x3", generations=60)
        result = job.result(60)
        lines = {text for text in log_texts(client, job) if "counts as infeasible" in text}
    assert (result.status, result.fitness) == ("exhausted", 1.0)
    sha = result.problem_sha256
    assert result.directives == [{"do": "infeasible", "problem_sha256": sha, "genomes": ["00"]}]
    assert lines == {"genome 00 counts as infeasible: its evaluation crashed (SIGSEGV, 2 times)"}
    file = supernode.load(tmp_path / "deadly.toml").with_run(topology="torus 1x3", generations=60)
    assert epochs.history(replay(file, result.directives)) == result.history_sha256


ENDLESS = """
import supernode


class Endless(supernode.Problem):
    @property
    def coding(self):
        return supernode.BitString(16, 1)

    def evaluate(self, genomes):
        while (genomes[:, 0] < 64).any():
            pass
        return genomes[:, 0].astype(float) + 1.0
"""


@pytest.mark.parametrize("mode", ["lockstep", "async"])
def test_an_evaluation_without_end_keeps_neither_job_nor_nodes(tmp_path, monkeypatch, mode):
    (tmp_path / "endless_module.py").write_text(ENDLESS)
    (tmp_path / "endless.toml").write_text('kind = "endless_module:Endless"\n[run]\ntarget = 0.0\n')
    (tmp_path / "good.toml").write_text('kind = "function"\nname = "onemax"\ndimension = 8\n')
    monkeypatch.chdir(tmp_path)
    options = ("--allow-module", "endless_module", "--eval-timeout", "2")
    with live(tmp_path / "state", "torus 2x2", *options) as service, service.connect() as client:
        job = client.submit(tmp_path / "endless.toml", topology="torus 2x2", seconds=1, mode=mode)
        assert job.result(60).status == "deadline"
        assert client.submit(tmp_path / "good.toml", topology="torus 2x2").result(60).status == "solved"
