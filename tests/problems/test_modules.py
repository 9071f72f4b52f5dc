from pathlib import Path

import pytest

from problems import BadInput, ProblemFile, Run
from problems.modules import AnyModules, Modules


def text(kind: str, folder: str = "/home/mallory") -> str:
    return ProblemFile("x.toml", {"kind": kind}, Run(), Path(folder)).to_json()


def test_a_module_that_is_not_allowed_is_refused_and_not_imported(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="it was not started with --allow-module antigravity"):
        Modules(["own"], tmp_path).read(text("antigravity:fly_with_it"))


def test_an_allowed_module_is_looked_for_where_this_process_says(tmp_path: Path) -> None:
    assert Modules(["own"], tmp_path).read(text("own:Problem")).folder == tmp_path
    assert Modules(["own"]).read(text("own:Problem")).folder == Path.cwd()


def test_built_in_kinds_are_allowed_always(tmp_path: Path) -> None:
    assert Modules((), tmp_path).read(text("arm-ik")).kind == "arm-ik"


def test_the_cluster_of_one_process_runs_what_that_one_says() -> None:
    assert AnyModules().read(text("own:Problem")).folder == Path("/home/mallory")
