"""Kernels are compiled before a cluster starts: which, in which order, and only those that the cache lacks."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import supernode
from coordinator.launch import compilation
from lowlevel import capabilities, kernel_cache
from problems import BadInput, registry
from problems.file import parse

MODULES = compilation._all_modules()
GROUPS = compilation._groups_of(MODULES)


def test_a_kind_needs_its_own_kernels_and_those_of_all_kinds():
    few = compilation._modules(["mobile-robot"])
    assert ("node.fast_path" in few) == capabilities().c_api
    assert {"genetics.bit_kernels", "problems.mobile_robot.kernels"} <= few.keys()
    assert {name for name in few if name.startswith("problems.") and ".mobile_robot." not in name} == set()
    assert few.keys() < compilation._modules(None).keys() < MODULES.keys()


def test_every_module_of_a_warm_start_is_compiled_beforehand():
    with_kernels = set(registry.kernels()) & MODULES.keys()  # others only import modules with kernels
    assert with_kernels <= compilation._modules(None).keys()


def test_each_process_waits_for_what_its_modules_import():
    assert sorted(name for group in GROUPS.values() for name in group) == sorted(MODULES)
    done = set()
    while len(done) < len(GROUPS):
        ready = {name for name in GROUPS if compilation._needs_of(name, GROUPS, MODULES) <= done} - done
        assert ready, "a circle"
        done |= ready
    assert "wire.exchange_reader" in compilation._needs_of("node", GROUPS, MODULES)


def test_what_is_compiled_is_marked_and_not_compiled_again(tmp_path):
    script = (
        "from coordinator.launch import compilation as c\n"
        "modules = {name: c._all_modules()[name] for name in ['genetics.sequence_kernels']}\n"
        "assert c._missing(modules) == modules\n"
        "assert c.compile_modules(modules) == []\n"
        "assert c._missing(modules) == {}\n"
    )
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    folders = [folder.name for folder in tmp_path.iterdir() if any(folder.glob("compiled-*"))]
    assert [name.rpartition("-")[0] for name in folders] == ["genetics.sequence_kernels"]


def test_a_module_that_cannot_be_compiled_is_named(tmp_path, capfd, monkeypatch):
    broken = tmp_path / "broken_kernels.py"
    broken.write_text("raise ValueError('no such kernel')\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(kernel_cache, "base_folder", lambda: tmp_path / "cache")
    assert compilation.compile_modules({"broken_kernels": broken}) == ["broken_kernels"]
    assert "no such kernel" in capfd.readouterr().err


def test_a_cluster_of_some_kinds_refuses_others():
    arm = parse(registry.find("arm-ik").template, "arm", Path())
    sphere = parse('kind = "function"\nname = "sphere"\ndimension = 2\n', "sphere", Path())
    with supernode.LocalCluster(torus=(1, 1), kinds=["function"]) as cluster:
        with pytest.raises(BadInput, match="expected function, for which this cluster was started, found 'arm-ik'"):
            cluster.submit(arm)
        result = cluster.submit(sphere, generations=3, target=-1.0).result()
    assert result.status == "exhausted"
