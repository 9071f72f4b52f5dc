"""What a problem says is to be turned when a run of it has stalled."""

from pathlib import Path

import pytest
from one_max import OneMax

from problems import Run, load
from problems.guard import advised

ROOT = Path(__file__).resolve().parents[2]
FURTHER = "to search further, try --torus 8x8, --deme 4, --stall 1000 or another --seed"
# A slot between two walls, which a disc fits through but not what is 0.4 m larger.
SLOT = """
kind = "sphere-path"
start = [1.0, 2.0]
goal = [7.0, 2.0]
bounds = [[0.0, 8.0], [0.0, 4.0]]
nodes = 1
accuracy = {accuracy}
vehicle = {{radius = 0.2}}
[[obstacles]]
shape = "box"
center = [4.0, 0.75]
size = [0.4, 1.5]
[[obstacles]]
shape = "box"
center = [4.0, 3.25]
size = [0.4, 1.5]
"""


def advice_for(example, found=None, **run):
    file = load(ROOT / "examples" / f"{example}.toml").with_run(**run)
    return file.problem().advice(found, file.run)


def test_a_robot_is_given_more_commands_and_more_nodes():
    further, commands = advice_for("mobile-robot", torus="4x4", seed=7)
    assert further == f"{FURTHER} (this run: torus 4x4, deme 1, stall 200, seed 7)"
    pairs = load(ROOT / "examples" / "mobile-robot.toml").problem().pairs
    more = min(2 * pairs, 64)
    assert commands == (
        f"a way with more turns takes more commands: try commands = {more} in the problem file (this run: {pairs})"
    )


def test_what_is_advised_can_be_done():
    problem = load(ROOT / "examples" / "arm-path.toml").problem()
    tried = {
        rounds: problem.model_copy(update={"rounds": rounds}).advice(None, Run())[1:] for rounds in (24, 900, 1000)
    }
    assert "try rounds = 48 in the problem file (this run: 24)" in tried[24][0]
    assert "try rounds = 1000 in the problem file (this run: 900)" in tried[900][0]
    assert tried[1000] == []


@pytest.mark.parametrize(
    ("topology", "said"),
    [
        (
            "torus 3x5",
            "try --torus 6x10, --deme 8, --stall 50 or another --seed (this run: torus 3x5, deme 2,",
        ),
        ("torus 32x32", "try --deme 8, --stall 50 or another --seed (this run: deme 2, stall 10,"),
        ("ring 16", "try --deme 8, --stall 50 or another --seed (this run: deme 2, stall 10,"),
    ],
)
def test_the_settings_are_those_of_the_run(topology, said):
    (line,) = advice_for("rastrigin", topology=topology, deme=2, stall=10)
    assert said in line


@pytest.fixture
def slot(tmp_path, monkeypatch):
    """The problem, with a certain accuracy of its spheres."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

    def read(accuracy):
        path = tmp_path / "slot.toml"
        path.write_text(SLOT.format(accuracy=accuracy))
        return load(path).problem()

    return read


def through(problem):
    """The straight way, with the spheres that it crosses."""
    from problems.sphere_path.checker import crossed_by

    return {"path": [[1.0, 2.0], [7.0, 2.0]], "crossed": crossed_by(problem, problem.straight), "length": 6.0}


def test_a_path_that_only_the_accuracy_closes_is_said_to_be_one(slot):
    coarse = slot(0.4)
    found = through(coarse)
    assert found["crossed"] > 0
    (line,) = coarse.advice(found, Run())
    assert line.startswith("`accuracy` is what blocks: the vehicle is free on the best path, 0.3 m clear of what")
    assert "try accuracy = 0.15 in the problem file (this run: 0.4)" in line
    finer = slot(0.15)
    assert through(finer)["crossed"] == 0


def test_of_a_path_that_meets_an_obstacle_the_accuracy_is_not_to_blame(slot):
    problem = slot(0.4)
    path = [[1.0, 2.0], [4.0, 1.0], [7.0, 2.0]]
    crossed = {"path": path, "crossed": 1, "length": 2.0 * 10.0**0.5}
    for found in (None, crossed):
        further, nodes = problem.advice(found, Run())
        assert further.startswith(FURTHER)
        assert "try nodes = 2 in the problem file (this run: 1)" in nodes


class Talkative(OneMax):
    """Advice of a user's own, which may be anything."""

    def advice(self, found, run):
        if found is None:
            raise RuntimeError("out of paper")
        return [f"two\nlines of {run.deme}", 3, ""]


def test_advice_of_a_users_own_is_guarded():
    problem = Talkative(kind="talkative")
    assert advised(problem, None, Run()) == ()
    assert advised(problem, {}, Run()) == ("two lines of 1",)
