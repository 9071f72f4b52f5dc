"""Kinds of problem are registered by entry points: the built-in ones, and those of a user's package."""

import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from coordinator.service.checking import is_own
from node.plan import Plan
from node.simulation import simulate
from problems import BadInput, load, registry

ROOT = Path(__file__).resolve().parents[2]
MODULE = """
import supernode

class Ones(supernode.Problem):
    about = "as many ones as possible"
    bits: int = 8

    @property
    def coding(self):
        return supernode.BitString(self.bits, 1)

    def evaluate(self, genomes):
        return self.bits - self.coding.integers(genomes).sum(axis=1)
"""


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Install a distribution with entry points, for one test."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def put(name, lines, module="warehouse_plans", text=MODULE):
        (tmp_path / f"{module}.py").write_text(text)
        info = tmp_path / f"{name}-1.0.dist-info"
        info.mkdir()
        (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (info / "entry_points.txt").write_text(f"[{registry.GROUP}]\n{lines}\n")
        registry._entries.cache_clear()

    yield put
    registry._entries.cache_clear()
    sys.modules.pop("warehouse_plans", None)


def test_what_is_installed_is_what_the_project_says():
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][registry.GROUP]
    installed = {entry.name: entry.value for entry in entry_points(group=registry.GROUP)}
    assert stated.items() <= installed.items(), "install the project again: pip install -e ."
    assert set(registry.kinds()) == stated.keys()
    planners = {path.parent.name for path in (ROOT / "problems").glob("*/planner.py")}
    assert {value.split(":")[0].removeprefix("problems.") for value in stated.values()} == planners


def test_a_package_adds_a_kind(install, tmp_path):
    install("warehouse", "ones = warehouse_plans:Ones")
    assert "ones" in registry.registered()
    assert "ones" not in registry.kinds()
    assert (registry.is_built_in("ones"), registry.is_users_own("ones")) == (False, True)
    (tmp_path / "ones.toml").write_text('kind = "ones"\nbits = 6\n[run]\ntopology = "torus 2x2"\ngenerations = 50\n')
    file = load(tmp_path / "ones.toml")
    assert "warehouse_plans" not in sys.modules, "reading a file runs no user's code"
    assert is_own(file), "and checking it does, in a process of its own"
    problem = file.problem()
    assert problem.bits == 6
    assert min(report.champion.fitness for report in simulate(Plan(problem, file.run))) == 0.0


def test_a_kind_of_a_package_is_listed_and_shown(install, capsys):
    from supernode.__main__ import main

    install("warehouse", "ones = warehouse_plans:Ones")
    assert main(["problems"]) == 0
    assert "as many ones as possible" in capsys.readouterr().out
    assert main(["problems", "ones"]) == 0
    assert "bits" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["ones", "arm-ik"])
def test_two_packages_with_the_same_name_are_refused_by_name(install, kind):
    install("warehouse", f"{kind} = warehouse_plans:Ones")
    install("harbour", f"{kind} = harbour_plans:Ones", "harbour_plans")
    with pytest.raises(BadInput, match=rf"one package that registers '{kind}'.*harbour \(.*uninstall all but one"):
        registry.find(kind)
    assert registry.find("function").__name__ == "Function", "other kinds are not affected"


def test_two_packages_may_register_the_same_class(install):
    install("warehouse", "ones = warehouse_plans:Ones")
    install("warehouse_again", "ones = warehouse_plans:Ones")
    assert registry.find("ones").__name__ == "Ones"


@pytest.mark.parametrize("text", ["raise OSError('no licence')", "import sys; sys.exit('no licence')"])
def test_a_package_that_cannot_be_imported_is_named(install, text):
    install("warehouse", "ones = warehouse_plans:Ones", text=text)
    with pytest.raises(BadInput, match=r"kind: cannot import 'ones': \w+: no licence"):
        registry.find("ones")


def test_what_is_no_problem_is_refused(install):
    install("warehouse", "ones = warehouse_plans:supernode")
    with pytest.raises(BadInput, match=r"expected a subclass of supernode\.Problem, found 'ones'"):
        registry.find("ones")


def test_an_unknown_kind_is_told_the_known_ones(install):
    install("warehouse", "ones = warehouse_plans:Ones")
    with pytest.raises(BadInput, match=r"terrain.*found 'onse'; did you mean 'ones'"):
        registry.find("onse")


def test_an_installation_without_kinds_is_told_what_to_do(monkeypatch):
    monkeypatch.setattr(registry, "entry_points", lambda group: ())
    registry._entries.cache_clear()
    with pytest.raises(BadInput, match="install this project again"):
        registry.kinds()
    registry._entries.cache_clear()


def test_names_are_read_without_importing_a_planner():
    code = (
        "import sys; from problems import registry; registry.registered(); sys.exit('problems.arm_ik' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, timeout=60, check=False).returncode == 0
