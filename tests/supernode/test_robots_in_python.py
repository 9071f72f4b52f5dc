"""Robots and their problems in Python."""

import json
from pathlib import Path

import numpy as np
import pytest

import supernode
from problems import registry
from problems.in_memory import InMemoryProblem
from problems.robots.fields import AttachedCylinder, BoxObstacle, MeshObstacle, Robot
from supernode.robots import _plain

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "robots"
ARM = EXAMPLES.parent / "arm-ik.toml"
START, GOAL = [1.2, 0.4, 1.0, 0.0, 1.2, 0.0], [-1.2, 0.4, 1.0, 0.0, 1.2, 0.0]
needs_robot_path = pytest.mark.skipif("robot-path" not in registry.registered(), reason="needs the kind robot-path")


def load(**options):
    return supernode.load_robot(EXAMPLES / "sorter.urdf", srdf=EXAMPLES / "sorter.srdf", group="arm", **options)


def test_a_robot_is_loaded_with_all_its_files():
    robot = load(base={"position": np.array([0.0, 1.0, 0.0])})
    assert isinstance(robot, Robot)
    assert (robot.group, robot.base.position) == ("arm", (0.0, 1.0, 0.0))
    assert "<robot" in robot.urdf
    assert "disable_collisions" in robot.srdf


def test_a_robot_of_the_extra_by_its_short_name():
    robot = supernode.load_robot("panda", group="arm")
    assert "<robot" in robot.urdf


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"fixed": {"turn": "far"}}, "load_robot: fixed.turn: expected a valid number"),
        ({"joints": ["turn"]}, "load_robot: joints: expected either group or joints, found both"),
        ({"packages": "."}, "packages: expected a list, found the text '.'"),
        ({"base": {"position": [0, 0]}}, "load_robot: base.position: expected 3 values, found 2"),
    ],
)
def test_wrong_fields_of_a_robot_are_named(options, expected):
    with pytest.raises(supernode.BadInput) as refused:
        load(**options)
    assert str(refused.value).startswith(expected)


def test_a_group_that_the_robot_does_not_have_is_refused_at_once():
    with pytest.raises(supernode.BadInput, match=r"robot\.group: expected one of .*, found 'amr'; did you mean 'arm'"):
        supernode.load_robot("panda", group="amr")


def test_a_missing_robot_is_named():
    with pytest.raises(supernode.BadInput, match=r"robot\.urdf: expected a file, found no file nowhere\.urdf"):
        supernode.load_robot("nowhere.urdf")


def test_solids_take_arrays_and_are_checked_at_once():
    box = supernode.Box(id="wall", size=np.array([1, 2, 3]), position=np.zeros(3))
    assert isinstance(box, BoxObstacle)
    assert _plain(box) == {"id": "wall", "shape": "box", "size": [1, 2, 3], "position": [0, 0, 0]}
    tool = supernode.Cylinder(radius=0.01, length=0.1, link="gripper", may_touch=["palm"])
    assert isinstance(tool, AttachedCylinder)
    assert _plain(supernode.Sphere(radius=1)) == {"shape": "sphere", "radius": 1.0}
    assert isinstance(supernode.Mesh(file=Path("a.stl"), scale=2), MeshObstacle)
    with pytest.raises(supernode.BadInput, match=r"Box: size: expected 3 values, found 2: \[1, 2\]"):
        supernode.Box(size=[1, 2])
    with pytest.raises(supernode.BadInput, match="Box: colour: unknown field, expected one of"):
        supernode.Box(size=[1, 2, 3], colour="red")


@needs_robot_path
def test_a_problem_of_objects_is_that_of_a_file(tmp_path):
    wall = supernode.Box(id="wall", size=[0.5, 0.04, 0.54], position=np.array([0.5, 0.0, 0.33]))
    problem = supernode.RobotPath(robot=load(), start=np.array(START), goal=GOAL, obstacles=[wall], clearance=0.005)
    text = f"""kind = "robot-path"
start = {START}
goal = {GOAL}
clearance = 0.005
[robot]
urdf = "{EXAMPLES / "sorter.urdf"}"
srdf = "{EXAMPLES / "sorter.srdf"}"
group = "arm"
[[obstacles]]
id = "wall"
shape = "box"
size = [0.5, 0.04, 0.54]
position = [0.5, 0.0, 0.33]
"""
    (tmp_path / "same.toml").write_text(text)
    of_file, in_memory = supernode.load(tmp_path / "same.toml"), InMemoryProblem.of(problem)
    assert in_memory.problem() == of_file.problem()
    assert json.loads(in_memory.to_json())[1].keys() == of_file.fields.keys()


@needs_robot_path
def test_a_path_is_an_array():
    problem = supernode.RobotPath(robot=load(), start=START, goal=GOAL)
    result = supernode.simulate(problem, torus="1x1", generations=2)
    assert result.feasible, result.message
    assert result.path.shape[1] == 6
    np.testing.assert_allclose(result.path[[0, -1]], [START, GOAL], atol=1e-9)
    assert result.configuration is None


def test_a_result_without_a_path_says_so():
    result = supernode.simulate(ARM, torus="2x2", generations=1)
    assert result.path is None
    assert result.trajectory is None


def test_solve_is_a_simulation_on_processes():
    file = supernode.load(ARM)
    settings = {"torus": "2x2", "generations": 20, "seed": 3}
    assert supernode.solve(file, **settings).history_sha256 == supernode.simulate(file, **settings).history_sha256
    problem = file.problem()  # a problem made in Python
    assert supernode.solve(problem, **settings).fitness == supernode.simulate(file, **settings).fitness
