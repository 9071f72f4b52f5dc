"""The problems of MotionBenchMaker in `../shared/data`, as fields of problem files and as scenes; for benchmarks."""

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

DATA = Path(__file__).resolve().parent.parent.parent / "shared" / "data"
_PANDA = [f"panda_joint{number}" for number in range(1, 8)]


class Problem(NamedTuple):
    """One problem: its name, the fields of its problem file, start and goal."""

    name: str
    robot: str
    fields: dict[str, Any]
    start: list[float]
    goal: list[float]


def problems(robot: str, first: int = 20, families: tuple[str, ...] = ()) -> Iterator[Problem]:
    """Yield the first problems of each family, or of the named ones."""
    for path in sorted((DATA / "motionbenchmaker" / robot).glob("*.json")):
        if families and path.stem not in families:
            continue
        content = json.loads(path.read_text(encoding="utf-8"))
        for each in content["problems"][:first]:
            yield _problem(robot, f"{robot} {path.stem} {each['index']}", content.get("joints", _PANDA), each)


def _problem(robot: str, name: str, joints: list[str], each: dict[str, Any]) -> Problem:
    fields = {
        "robot": {
            "urdf": str(DATA / robot / f"{robot}.urdf"),
            "srdf": str(DATA / robot / f"{robot}.srdf"),
            "packages": [str(DATA / robot)],
            "joints": joints,
            "fixed": {joint: value for joint, value in each.get("others", {}).items() if joint in _moving(robot)},
        },
        "obstacles": [_obstacle(one) for one in each["obstacles"]],
    }
    return Problem(name, robot, fields, each["start"], each["goal"])


@cache
def _moving(robot: str) -> frozenset[str]:
    """Return the names of the joints that the URDF does not weld, as it does with some fingers."""
    root = ElementTree.parse(DATA / robot / f"{robot}.urdf").getroot()
    return frozenset(joint.attrib["name"] for joint in root.findall("joint") if joint.attrib["type"] != "fixed")


def _obstacle(one: dict[str, Any]) -> dict[str, Any]:
    sizes = one["dimensions"]
    shape = {
        "box": lambda: {"size": sizes},
        "cylinder": lambda: {"length": sizes[0], "radius": sizes[1]},
        "sphere": lambda: {"radius": sizes[0]},
    }[one["shape"]]()
    return {
        "id": one["id"],
        "shape": one["shape"],
        "position": one["position"],
        "quaternion": one["quaternion_xyzw"],
        **shape,
    }


def scene_of(problem: Problem) -> Any:
    """Return the compact model of a problem's scene (`problems.robots.arm.Scene`)."""
    from problems.robots.fields import BoxObstacle, CylinderObstacle, Robot, SphereObstacle
    from problems.robots.making import make_scene

    kinds: dict[str, Any] = {"box": BoxObstacle, "cylinder": CylinderObstacle, "sphere": SphereObstacle}
    obstacles = [kinds[each["shape"]].model_validate(each) for each in problem.fields["obstacles"]]
    return make_scene(Robot.model_validate(gathered(problem)), obstacles)


def gathered(problem: Problem) -> dict[str, Any]:
    """Return the fields of ``[robot]`` with all files read."""
    own = problem.fields["robot"]
    return {**_texts(problem.robot), "joints": own["joints"], "fixed": own["fixed"]}


@cache
def _texts(robot: str) -> dict[str, Any]:
    from problems.robots.loading import gather_robot

    own = next(problems(robot, 1)).fields["robot"]
    return dict(gather_robot({"robot": {**own, "joints": None, "fixed": {}}}, DATA)["robot"])
