"""Turn a scene and a robot into the fields of a problem file."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from problems.errors import BadInput, did_you_mean
from supernode.scenes import shapes
from supernode.scenes.places import HERE, Floats, inverse, position_of, quaternion_of
from supernode.scenes.robot import RobotOfScene
from supernode.scenes.scene import Scene, Solid

KINDS = ("robot-path", "robot-ik")
_MOST_FRAMES = 64  # in a row, before it is a circle


@dataclass(frozen=True)
class Wishes:
    """The user's options, beside the files.

    Attributes:
        kind: one of `KINDS`.
        start: numbers separated by commas, or the name of a state of the SRDF; None: the scene's.
        goal: likewise.
        folder: the folder of the problem file.
        meshes: the folder for meshes that the scene holds itself; None if there is none to write to.
    """

    kind: str
    start: str | None
    goal: str | None
    folder: Path
    meshes: Path | None


@dataclass(frozen=True)
class Imported:
    """The fields of a problem file, the meshes to write (file to its text), and what was left out or is missing."""

    fields: dict[str, Any]
    meshes: dict[Path, str]
    notes: list[str]


def fields_of(scene: Scene, robot: RobotOfScene, wishes: Wishes) -> Imported:
    """Return a problem file for a scene.

    Raises:
        BadInput: if the scene and the robot do not fit, or the scene holds what a problem file cannot.
    """
    return _Writer(scene, robot, wishes).imported()


class _Writer:
    def __init__(self, scene: Scene, robot: RobotOfScene, wishes: Wishes) -> None:
        self.scene, self.robot, self.wishes = scene, robot, wishes
        self.meshes: dict[Path, str] = {}
        self.notes = list(scene.notes)
        self.variables, self.group = robot.variables(scene)
        self.values = dict(scene.values)
        if scene.joints is not None and scene.joints != self.variables:
            if len(scene.joints) != len(self.variables):
                raise BadInput(
                    f"{robot.path}: expected {len(scene.joints)} joints that move, as the scene has, found "
                    f"{', '.join(self.variables)}; choose them by --group"
                )
            names = dict(zip(scene.joints, self.variables, strict=True))
            self.values = {names.get(name, name): value for name, value in self.values.items()}
            self.goals = [{names.get(name, name): value for name, value in goal.items()} for goal in scene.goals]
        else:
            self.goals = scene.goals
        self.links = robot.links_at(self.values, scene.base)

    def imported(self) -> Imported:
        fields: dict[str, Any] = {"kind": self.wishes.kind} | self._ends()
        fields["robot"] = self._robot()
        if self.scene.solids:
            fields["obstacles"] = [self._table(each, self._place(each)) for each in self.scene.solids]
        if self.scene.attached:
            fields["attached"] = [self._attached(number) for number in range(len(self.scene.attached))]
        return Imported(fields, self.meshes, self.notes)

    # Start and goal ---------------------------------------------------------------------------------------------------
    def _ends(self) -> dict[str, Any]:
        start = self._wished(self.wishes.start, "--start")
        if start is None and any(name in self.values for name in self.variables):
            start = self._configuration(self.values, {}, "start")
        if self.wishes.kind == "robot-ik":
            if self.wishes.start is not None or self.wishes.goal is not None:
                raise BadInput("--kind: expected robot-path with --start or --goal, found robot-ik; its goal is a pose")
            return self._pose()
        ends = {"start": start}
        if start is None:
            self._missing("start = [..], or say --start: the scene has no state of the robot")
        goal = self._wished(self.wishes.goal, "--goal")
        if goal is not None:
            return ends | {"goal": goal}
        goals = [self._configuration(each, self.values, "goal") for each in self.goals]
        if len(goals) == 1:
            return ends | {"goal": goals[0]}
        return ends | ({"goals": goals} if goals else self._pose())

    def _pose(self) -> dict[str, Any]:
        pose = self.scene.pose
        if pose is None:
            if self.wishes.kind == "robot-ik" and self.goals:
                raise BadInput("--kind: expected robot-path for a goal that is a configuration, found robot-ik")
            is_path = self.wishes.kind == "robot-path"
            goal = "goal = [..], or [goal_pose], or say --goal" if is_path else "[goal_pose]"
            self._missing(f"{goal}: the scene has no goal")
            return {}
        if pose.link not in self.links:
            raise BadInput(
                f"{pose.where}.link_name: expected a link of {self.robot.path}, found {pose.link!r}"
                f"{did_you_mean(pose.link, self.links)}"
            )
        frame = self._frame(pose.frame, pose.where)
        fields: dict[str, Any] = {"link": pose.link}
        fields["position"] = position_of(frame @ _moved(pose.position))
        if pose.rotation is not None:
            fields["quaternion"] = quaternion_of(frame[:3, :3] @ pose.rotation)
            fields["angle_tolerance"] = pose.angle_tolerance
        return {"goal_pose": fields | {"position_tolerance": pose.position_tolerance}}

    def _configuration(self, values: Mapping[str, float], default: Mapping[str, float], what: str) -> list[float]:
        for name in values:
            if what == "goal" and name not in self.variables:
                self.notes.append(f"{what}: {name} is left out; it does not move here")
        taken = [name for name in self.variables if name not in values and name in default]
        if taken:
            self.notes.append(f"{what}: the scene has no value of {', '.join(taken)}; the start's was taken")
        return [self._value(name, values.get(name, default.get(name)), what) for name in self.variables]

    def _value(self, name: str, value: float | None, what: str) -> float:
        if value is None:
            self.notes.append(f"{what}: the scene has no value of {name}; 0 or the nearest limit was taken")
            return self.robot.within_limits(name, 0.0)
        return self._clipped(name, value, what)

    def _clipped(self, name: str, value: float, what: str) -> float:
        within = self.robot.within_limits(name, value)
        if within != value:
            self.notes.append(f"{what}: {name} was moved from {value:.6g} to its limit {within:.6g}")
        return within

    def _wished(self, text: str | None, option: str) -> list[float] | None:
        """Return the configuration of an option: numbers, or the name of a state of the SRDF."""
        if text is None:
            return None
        states = self._states()
        if text in states:
            return [states[text].get(name, self.values.get(name, 0.0)) for name in self.variables]
        try:
            numbers = [float(each) for each in text.split(",")]
        except ValueError:
            known = f", or one of the SRDF's states {', '.join(states)}" if states else ""
            raise BadInput(
                f"{option}: expected numbers separated by commas{known}, found {text!r}{did_you_mean(text, states)}"
            ) from None
        if len(numbers) != len(self.variables):
            names = ", ".join(self.variables)
            raise BadInput(f"{option}: expected {len(self.variables)} numbers ({names}), found {len(numbers)}")
        return [self._clipped(name, value, option) for name, value in zip(self.variables, numbers, strict=True)]

    def _states(self) -> dict[str, dict[str, float]]:
        every = self.robot.srdf.states
        return dict(every.get(self.group or "", {})) or {
            name: one for own in every.values() for name, one in own.items()
        }

    def _missing(self, what: str) -> None:
        self.notes.append(f"add {what}")

    # Robot and solids -------------------------------------------------------------------------------------------------
    def _robot(self) -> dict[str, Any]:
        table = dict(self.robot.table(self.wishes.folder))
        if self.group is not None:
            table["group"] = self.group
        elif self.variables != self.robot.urdf.movable:
            table["joints"] = self.variables
        fixed = {}
        for name, value in self.values.items():
            if name in self.robot.urdf.movable and name not in self.variables:
                fixed[name] = self._clipped(name, value, "fixed")
        if fixed:
            table["fixed"] = fixed
        base = self.scene.base
        if base is not None and abs(base - HERE).max() > 0.0:
            table["base"] = _placed(base)
        return table

    def _place(self, solid: Solid) -> Floats:
        return self._frame(solid.frame, solid.where) @ solid.pose

    def _frame(self, name: str, where: str, depth: int = 0) -> Floats:
        """Return the place of a frame in the world."""
        if name in self.links:
            return self.links[name]
        if name in self.robot.world_frames:
            return HERE
        if name not in self.scene.frames or depth > _MOST_FRAMES:
            known = [*sorted(self.robot.world_frames), self.robot.urdf.root]
            raise BadInput(
                f"{where}: expected a frame that is known ({', '.join(known)}, links of the robot, or the scene's "
                f"fixed_frame_transforms), found {name!r}{did_you_mean(name, self.links)}"
            )
        parent, pose = self.scene.frames[name]
        return self._frame(parent, where, depth + 1) @ pose

    def _attached(self, number: int) -> dict[str, Any]:
        thing = self.scene.attached[number]
        if thing.link not in self.links:
            raise BadInput(
                f"{thing.solid.where}: expected a link of {self.robot.path}, found {thing.link!r}"
                f"{did_you_mean(thing.link, self.links)}"
            )
        is_own = thing.solid.frame == thing.link
        pose = thing.solid.pose if is_own else inverse(self.links[thing.link]) @ self._place(thing.solid)
        table = {"link": thing.link} | self._table(thing.solid, pose)
        touched = [name for name in thing.may_touch if name in self.links]
        return table | ({"may_touch": touched} if touched else {})

    def _table(self, solid: Solid, pose: Floats) -> dict[str, Any]:
        table = {"id": solid.id} | solid.fields
        if solid.mesh is not None:
            table["file"] = self._mesh_file(solid)
        elif solid.fields["shape"] == "mesh":
            path = self.robot.finder.find(solid.fields["file"], solid.where)
            table["file"] = os.path.relpath(path.resolve(), self.wishes.folder.resolve())
        return table | _placed(pose)

    def _mesh_file(self, solid: Solid) -> str:
        """Return the name of a mesh's new file, relative to the problem file."""
        assert solid.mesh is not None
        if self.wishes.meshes is None:
            raise BadInput(f"-o: expected a file, as the mesh {solid.id!r} is written beside it, found none")
        stem = re.sub(r"[^\w.-]+", "_", solid.id).strip("._") or "mesh"
        path, number = self.wishes.meshes / f"{stem}.obj", 1
        while path in self.meshes:
            number += 1
            path = self.wishes.meshes / f"{stem}-{number}.obj"
        self.meshes[path] = shapes.as_obj(solid.mesh)
        return os.path.relpath(path.resolve(), self.wishes.folder.resolve())


def _placed(pose: Floats) -> dict[str, Any]:
    quaternion = quaternion_of(pose)
    place = {"position": position_of(pose)}
    return place if quaternion == [0.0, 0.0, 0.0, 1.0] else place | {"quaternion": quaternion}


def _moved(position: Floats) -> Floats:
    pose = HERE.copy()
    pose[:3, 3] = position
    return pose
