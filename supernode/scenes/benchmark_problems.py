"""Read MotionBenchMaker's problems as JSON: many problems of one robot and one family in one file."""

from __future__ import annotations

from typing import Any

from problems.errors import BadInput
from supernode.scenes import shapes
from supernode.scenes.plain_node import Node
from supernode.scenes.scene import WORLD, Scene, Solid

_FINGERS = ("panda_finger_joint1", "panda_finger_joint2")  # problems of the Panda give their values without names


def is_benchmark(plain: Any) -> bool:
    """Return whether these are such problems."""
    return isinstance(plain, dict) and isinstance(plain.get("problems"), list)


def read_problem(plain: Any, number: int, file: str) -> Scene:
    """Return one problem.

    Args:
        plain: the file's values.
        number: the problem's ``index``, or its place, counted from 1, if the problems have none.
        file: the file's name, for messages.

    Raises:
        BadInput: if there is no such problem, or a field is wrong.
    """
    whole = Node(plain, file)
    problems = whole.each("problems")
    numbers = [_index(each, place) for place, each in enumerate(problems, 1)]
    if number not in numbers:
        known = f"{min(numbers)} to {max(numbers)}" if numbers else "none"
        raise BadInput(f"--problem: expected one of the problems of {file} ({known}), found {number}")
    problem = problems[numbers.index(number)]
    start, goal = problem.need("start").numbers(), problem.need("goal").numbers()
    joints = [each.text() for each in whole.each("joints")]
    robot = whole.get("robot")
    if joints and not len(joints) == len(start) == len(goal):
        raise problem.error(f"start and goal of {len(joints)} values", "; they are in the order of joints")
    if len(start) != len(goal):
        raise BadInput(f"{problem.where}.goal: expected {len(start)} values as in start, found {len(goal)}")
    # Without names, the robot's own joints in their order are meant; `problem_fields` names them.
    names = joints or [f"#{place}" for place in range(len(start))]
    others = problem.get("others")
    values = {} if others is None else {name: each.number() for name, each in others.items()}
    values |= dict(zip(_FINGERS, (each.number() for each in problem.each("fingers")), strict=False))
    return Scene(
        solids=[_solid(each) for each in problem.each("obstacles")],
        values=values | dict(zip(names, start, strict=True)),
        model=None if robot is None else robot.text(),
        joints=names,
        goals=[dict(zip(names, goal, strict=True))],
    )


def _index(problem: Node, place: int) -> int:
    index = problem.get("index")
    return place if index is None else int(index.number())


def _solid(node: Node) -> Solid:
    kind, sizes = node.need("shape").text(), node.need("dimensions").numbers()
    if kind == "cylinder":  # length, then radius
        sizes = sizes[::-1]
    fields, mesh = shapes.primitive(kind, sizes, node.where)
    return Solid(
        node.need("id").text().strip(), fields, WORLD, node.place(quaternion="quaternion_xyzw"), node.where, mesh
    )
