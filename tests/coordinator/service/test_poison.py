"""A user's problem whose code crashes processes: its job fails, and nobody else's."""

import pytest
from live_service import live

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
"""


@pytest.fixture
def service(tmp_path, monkeypatch):
    (tmp_path / "poison_module.py").write_text(MODULE)
    (tmp_path / "poison.toml").write_text('kind = "poison_module:Poison"\n[run]\ntarget = 0.0\nstall = 1000000\n')
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with live(tmp_path / "state", "torus 2x4", "--allow-module", "poison_module") as service:
        yield service


def test_the_job_fails_and_says_why_and_another_goes_on(service, tmp_path):
    before = service.info().process
    with service.connect() as client:
        good = tmp_path / "good.toml"
        good.write_text('kind = "function"\nname = "onemax"\ndimension = 8\n[run]\ntarget = -1.0\n')
        other = client.submit(good, topology="torus 1x4", seconds=120)
        for _ in range(2):
            result = client.submit(tmp_path / "poison.toml", topology="torus 1x4").result(60)
            assert result.status == "failed"
            assert result.message == (
                "the problem's code has crashed the processes of several nodes, the last one by SIGSEGV"
            )
        assert other.state() == "running"
        other.cancel()
        assert other.result(60).status == "cancelled"
    assert service.info().process == before


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
