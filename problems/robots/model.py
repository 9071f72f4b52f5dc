"""The part of a model that robot-ik and robot-path share: a robot described by URDF among obstacles."""

from __future__ import annotations

import json
from functools import cached_property
from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError

from problems.angles import WithAngles
from problems.robots.arm import Scene
from problems.robots.fields import Attached, Obstacle, Robot
from problems.tables import Table, derived, quantity


class _Parts(Table):
    """The fields from which the compact model is made."""

    robot: Robot
    obstacles: list[Obstacle] = Field(default_factory=list)
    attached: list[Attached] = Field(default_factory=list)


class RobotModel(WithAngles):
    """The fields of a robot and its scene, how files are read into them, and the compact model."""

    clearance: float = quantity(
        "m", "how far every part of the robot keeps from obstacles and from itself", default=0.0, ge=0, le=10.0
    )
    robot: Robot = quantity("", "the robot")
    obstacles: list[Obstacle] = quantity("", "solid shapes that stand still", default_factory=list)
    attached: list[Attached] = quantity("", "solid shapes that move with a link", default_factory=list)
    model: str | None = derived("the robot and its scene as the planner needs them", default=None)

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Replace the names of URDF, SRDF and meshes by what these files hold."""
        from problems.robots.loading import gather_robot, held_in_radians, is_read

        gathered = gather_robot(fields, folder)
        if fields.get("written_in") != "deg" or is_read(fields.get("robot")) or not is_read(gathered.get("robot")):
            return gathered
        return {**gathered, "robot": held_in_radians(gathered["robot"])}

    @classmethod
    def derive_fields(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """Add the compact model of robot and scene, the pairs that may touch where no SRDF says, and what follows."""
        from problems.robots.making import make_scene, make_srdf

        given = {name: fields[name] for name in _Parts.model_fields if name in fields}
        try:
            parts = _Parts.model_validate_json(json.dumps(given), strict=True)
        except ValidationError:
            return fields  # validation of the whole reports it
        srdf = make_srdf(parts.robot)
        scene = make_scene(parts.robot.model_copy(update={"srdf": srdf}), parts.obstacles, parts.attached)
        derived = {**fields, "robot": {**fields["robot"], "srdf": srdf}, "model": scene.to_text()}
        return derived | cls.derive_from_scene(fields, scene)

    @classmethod
    def derive_from_scene(cls, fields: dict[str, Any], scene: Scene) -> dict[str, Any]:
        """Return further fields that follow from the scene; none by default. ``scene`` has no clearance."""
        return {}

    @cached_property
    def scene(self) -> Scene:
        """The compact model: the robot with all that surrounds it."""
        if self.model is not None:
            return Scene.from_text(self.model).with_clearance(self.clearance)
        from problems.robots.making import make_scene  # made in Python, not read from a file

        return make_scene(self.robot, self.obstacles, self.attached, self.clearance)
