"""Rivals of robot-path that bring their own collision tests: `mplib` and `roboplan`, each an extra package.

They get the URDF, SRDF, meshes and obstacles of the problem. Both test motions at discrete configurations, so some of
their paths fail the proof. The first path of each is offered as it was found and then simplified; later ones only
simplified. They start again after each path until the time is over.

mplib: its RRTConnect in steps of 0.1 rad, as `mplib.Planner.plan_qpos` has it, without parametrising the path by time.
It needs numpy 1, so it runs in a process of another Python: `MPLIB_PYTHON`, see `benchmarks.robot_mplib`.
roboplan: its RRT-Connect and shortcuts, with their defaults: bisection down to steps of 0.05 rad.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from problems.robot_path import RobotPath
from problems.robots.fields import Placed
from problems.robots.meshes import mesh_of

if TYPE_CHECKING:
    from benchmarks.robot_rivals import Search

Run = Callable[["Search"], None]
Rows = list[list[float]]

_MOST_NODES = 10_000_000  # of roboplan's trees, which would stop at 1000


# What both need -------------------------------------------------------------------------------------------------------
def _refuse_what_they_lack(problem: RobotPath) -> None:
    if problem.attached or problem.robot.base != Placed() or any(each.shape == "mesh" for each in problem.obstacles):
        raise ValueError("expected a robot at the origin, without attached things, among boxes, cylinders and spheres")


def _joints(problem: RobotPath) -> list[str]:
    return list(problem.scene.arm.joints)


def _values(problem: RobotPath) -> dict[str, float]:
    """Return where joints stand at the start, by name; the others stand at 0 or at their nearest limit."""
    return problem.robot.fixed | dict(zip(_joints(problem), problem.start, strict=True))


def _standing(urdf: str, joints: list[str]) -> list[str]:
    """Return the links that no given joint moves. They may touch obstacles, such as the table on which they stand."""
    parents = {}
    for joint in ElementTree.fromstring(urdf).findall("joint"):
        mimic = joint.find("mimic")
        moves = joint.get("name") in joints or (mimic is not None and mimic.get("joint") in joints)
        parents[_link(joint, "child")] = _link(joint, "parent"), moves

    def stands(link: str) -> bool:
        parent, moves = parents.get(link, (None, False))
        return not moves and (parent is None or stands(parent))

    links = [str(link.get("name")) for link in ElementTree.fromstring(urdf).findall("link")]
    return [link for link in links if stands(link)]


def _link(joint: ElementTree.Element, end: str) -> str:
    element = joint.find(end)
    return "" if element is None else str(element.get("link"))


def _placements(problem: RobotPath) -> Iterator[tuple[str, Any, NDArray[np.float64]]]:
    """Yield the name, the table and the 4×4 placement of each obstacle."""
    for number, obstacle in enumerate(problem.obstacles):
        placement = np.vstack([obstacle.placement.reshape(3, 4), [0.0, 0.0, 0.0, 1.0]])
        yield f"obstacle {number}", obstacle, placement


# mplib ----------------------------------------------------------------------------------------------------------------
@contextlib.contextmanager
def mplib(problem: RobotPath, _folder: Path, seed: int) -> Iterator[Run]:
    """Give a run of mplib's RRTConnect, in a process of the Python that `MPLIB_PYTHON` names."""
    _refuse_what_they_lack(problem)
    joints, (urdf, meshes) = _joints(problem), _with_plain_meshes(problem)
    children = {
        str(joint.get("name")): _link(joint, "child") for joint in ElementTree.fromstring(urdf).findall("joint")
    }
    scene = {
        "urdf": urdf,
        "srdf": problem.robot.srdf or "<robot/>",
        "meshes": meshes,
        "joints": joints,
        "links": [children[joint] for joint in joints],
        "values": _values(problem),
        "standing": _standing(urdf, joints),
        "obstacles": [
            each.model_dump(mode="json") | {"placement": placement.tolist()}
            for _, each, placement in _placements(problem)
        ],
        "seed": seed,
    }
    child = _Child(scene)
    try:
        yield lambda search: _plan(problem, child, search)
    finally:
        child.close()


def _with_plain_meshes(problem: RobotPath) -> tuple[str, dict[str, str]]:
    """Return the URDF and its meshes as OBJ texts by their names in it: mplib does not read files with loose edges."""
    tree, meshes = ElementTree.fromstring(problem.robot.urdf), {}
    for link in tree.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
    for number, mesh in enumerate(tree.iter("mesh")):
        x, y, z = (float(each) for each in mesh.attrib.pop("scale", "1 1 1").split())
        vertices, triangles = mesh_of(problem.robot.meshes, mesh.get("filename", ""), (x, y, z))
        lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles.tolist()]
        mesh.set("filename", f"{number}.obj")
        meshes[f"{number}.obj"] = "\n".join(lines)
    return ElementTree.tostring(tree, "unicode"), meshes


def _plan(problem: RobotPath, child: _Child, search: Search) -> None:
    ends = {"start": problem.start, "goal": problem.ends[0]}
    while not search.is_over:
        is_first = not search.has_proven
        path = child.ask(search, ends | {"seconds": max(1e-3, search.left), "simplify": not is_first})
        if path is None:
            continue
        search.offer(_exact(problem, path))
        if is_first:
            shorter = child.ask(search, ends | {"path": path})
            if shorter is not None:
                search.offer(_exact(problem, shorter))


class _Child:
    """A process of `benchmarks/robot_mplib.py` for one scene."""

    def __init__(self, scene: dict[str, Any]) -> None:
        script = Path(__file__).with_name("robot_mplib.py")
        python = os.environ.get("MPLIB_PYTHON", sys.executable)
        pipe = subprocess.PIPE
        self._process = subprocess.Popen(
            [python, str(script)], stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, text=True
        )
        try:
            self._answer(scene)
        except json.JSONDecodeError:
            self.close()
            raise ValueError(f"expected a Python with mplib and numpy 1, found {python}; set MPLIB_PYTHON") from None
        except ValueError:
            self.close()
            raise

    def ask(self, search: Search, question: dict[str, Any]) -> Rows | None:
        """Return the path; its processor time is the search's."""
        answer = self._answer(question)
        search.cpu_elsewhere += answer["cpu"]
        path: Rows | None = answer["path"]
        return path

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def _answer(self, question: dict[str, Any]) -> dict[str, Any]:
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        stdin.write(json.dumps(question) + "\n")
        stdin.flush()
        answer: dict[str, Any] = json.loads(stdout.readline())
        if answer["error"] is not None:
            raise ValueError(answer["error"])
        return answer


# roboplan -------------------------------------------------------------------------------------------------------------
@contextlib.contextmanager
def roboplan(problem: RobotPath, folder: Path, seed: int) -> Iterator[Run]:
    """Give a run of roboplan's RRT-Connect."""
    from roboplan import core, rrt

    _refuse_what_they_lack(problem)
    urdf, values = problem.robot.urdf.replace("package://", f"{folder.resolve()}/"), _values(problem)
    scene = core.Scene("scene", core.loadUrdfSceneDescriptionFromXml(urdf, [folder]))
    scene.importSrdf(problem.robot.srdf or "<robot/>")
    joints = _joints(problem)
    scene.addGroup("moving", joints)
    standing, names = _standing(urdf, joints), scene.getJointNames()
    low, high = scene.getPositionLimitVectors()
    positions = np.array(scene.getCurrentJointPositions())
    for name in names:
        (index, *more) = scene.getJointPositionIndices([name])
        if more:
            raise ValueError(f"expected joints with limits, found {name} without")
        positions[index] = np.clip(values.get(name, 0.0), low[index], high[index])
    scene.setJointPositions(positions)
    for name, obstacle, placement in _placements(problem):
        add, shape = _solid(core, scene, obstacle)
        add(name, "universe", shape, np.asfortranarray(placement), np.ones(4))
        scene.setCollisions([(each, name) for each in standing], False)
        standing.append(name)  # obstacles may touch each other, too
    options = rrt.RRTOptions(group_name="moving", max_nodes=_MOST_NODES, rrt_connect=True)
    shortcuts = core.PathShortcutter(scene, core.PathShortcuttingOptions(group_name="moving", seed=seed))
    planner = rrt.RRT(scene, options)
    planner.setRngSeed(seed)
    start, goal = (core.JointConfiguration(joints, np.array(each)) for each in (problem.start, problem.ends[0]))

    def run(search: Search) -> None:
        while not search.is_over:
            options.max_planning_time = max(1e-3, search.left)
            planner.setOptions(options)
            try:
                path = planner.plan(start, goal)
            except RuntimeError:  # no path in time
                continue
            if not search.has_proven:
                search.offer(_exact(problem, np.array(path.positions).tolist()))
            search.offer(_exact(problem, np.array(shortcuts.shortcut(path).positions).tolist()))

    yield run


def _solid(core: Any, scene: Any, obstacle: Any) -> tuple[Callable[..., None], Any]:
    match obstacle.shape:
        case "box":
            return scene.addBoxGeometry, core.Box(*obstacle.size)
        case "cylinder":
            return scene.addCylinderGeometry, core.Cylinder(obstacle.radius, obstacle.length)
        case _:
            return scene.addSphereGeometry, core.Sphere(obstacle.radius)


def _exact(problem: RobotPath, path: Rows) -> Rows:
    """Return a path whose ends are those of the problem to the last bit."""
    return [list(problem.start), *path[1:-1], list(problem.ends[0])]
