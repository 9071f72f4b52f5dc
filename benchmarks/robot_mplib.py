"""A process that plans by mplib, for `benchmarks.robot_own_checks`: mplib 0.2.1 needs numpy 1, this project numpy 2.

A Python that has mplib runs it as a script; it imports nothing of this project. Each line of its input is a question as
JSON, and is answered by a line of JSON. The first question is the scene: ``urdf`` and ``srdf`` (texts), ``meshes``
(texts by file name), ``joints`` (in the order of configurations), ``links`` (which these joints move), ``values``
(where joints stand, by name), ``standing`` (links that may touch obstacles), ``obstacles`` (shape, sizes, 4×4
placement) and ``seed``; its answer is ``error``, None if all is well, as in every answer. The others ask for a path by
``start``, ``goal``, ``seconds`` and ``simplify``, or to simplify a ``path``; answers are ``path``, None if there is
none, and ``cpu``, the processor time, s.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mplib
import numpy as np
from mplib.collision_detection import fcl
from mplib.pymp import Pose, set_global_seed

STEP = 0.1  # rad: the range of the trees, which is the default of `mplib.Planner.plan_qpos`


def read(scene: dict[str, Any]) -> tuple[Any, list[int], list[int]]:
    """Return mplib's planner, and how joints are ordered from ours to mplib's, and back."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        for mesh, text in scene["meshes"].items():
            (place / mesh).write_text(text)
        urdf, srdf = place / "_robot.urdf", place / "_robot.srdf"
        urdf.write_text(scene["urdf"])  # mplib puts the URDF's folder before all names of meshes
        srdf.write_text(scene["srdf"])
        planner = mplib.Planner(str(urdf), scene["links"][-1], srdf=str(srdf))
    planner.robot.set_move_group(scene["links"])
    names = planner.user_joint_names
    order = [names[index] for index in planner.robot.get_move_group_joint_indices()]
    if sorted(order) != sorted(scene["joints"]):
        raise ValueError(f"expected to move {scene['joints']}, found that the chain to their links moves {order}")
    low, high = np.asarray(planner.joint_limits).T
    planner.robot.set_qpos(np.clip([scene["values"].get(name, 0.0) for name in names], low, high), True)
    allowed = planner.planning_world.get_allowed_collision_matrix()
    for number, each in enumerate(scene["obstacles"]):
        name = f"obstacle {number}"
        placement = Pose(np.array(each["placement"]))
        planner.planning_world.add_object(name, fcl.CollisionObject(shape_of(each), placement))
        for link in scene["standing"]:
            allowed.set_entry(link, name, True)
    set_global_seed(scene["seed"])
    return planner, [scene["joints"].index(name) for name in order], [order.index(name) for name in scene["joints"]]


def shape_of(obstacle: dict[str, Any]) -> Any:
    """Return an obstacle's shape."""
    if obstacle["shape"] == "box":
        return fcl.Box(np.array(obstacle["size"]))
    if obstacle["shape"] == "cylinder":
        return fcl.Cylinder(obstacle["radius"], obstacle["length"])
    return fcl.Sphere(obstacle["radius"])


def path_of(planner: Any, there: list[int], back: list[int], asked: dict[str, Any]) -> Any:
    """Return the path that a question asks for."""
    if "path" in asked:
        return planner.planner.simplify_path(np.array(asked["path"])[:, there])[:, back].tolist()
    start, goal = np.array(asked["start"])[there], np.array(asked["goal"])[there]
    status, path = planner.planner.plan(start, [goal], time=asked["seconds"], range=STEP, simplify=asked["simplify"])
    return np.asarray(path)[:, back].tolist() if status == "Exact solution" else None


def main() -> None:
    """Answer until the input ends."""
    answers = sys.stdout
    sys.stdout = sys.stderr  # mplib prints
    try:
        planner, there, back = read(json.loads(sys.stdin.readline()))
    except Exception as error:
        print(json.dumps({"error": f"{type(error).__name__}: {error}"}), file=answers, flush=True)
        return
    print(json.dumps({"error": None}), file=answers, flush=True)
    for line in sys.stdin:
        began = time.process_time()
        answer: dict[str, Any] = {"path": None, "error": None}
        try:
            answer["path"] = path_of(planner, there, back, json.loads(line))
        except Exception as error:
            answer["error"] = f"{type(error).__name__}: {error}"
        print(json.dumps(answer | {"cpu": time.process_time() - began}), file=answers, flush=True)


main()
