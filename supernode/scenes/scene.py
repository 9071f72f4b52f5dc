"""A scene from elsewhere: solids, the robot's state, and where it is to go."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mesh = tuple[Floats, NDArray[np.int64]]  # vertices (V, 3), m, and triangles (T, 3)

WORLD = "world"


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid in a frame of the scene.

    Attributes:
        id: its name in the scene, unique unless the scene repeats it.
        fields: ``shape`` and its sizes as problem files have them; without ``file`` for a mesh of ``mesh``.
        frame: the name of a link, of one of `Scene.frames`, or `WORLD`.
        pose: its place in that frame, (4, 4).
        mesh: its triangles, if no file holds them.
        where: the start of a message about it: the file and the field.
    """

    id: str
    fields: dict[str, Any]
    frame: str
    pose: Floats
    where: str
    mesh: Mesh | None = None


@dataclass(frozen=True, eq=False)
class Attached:
    """A solid that moves with a link, and the links that it may touch."""

    solid: Solid
    link: str
    may_touch: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class PoseGoal:
    """A pose that a link shall reach.

    Attributes:
        frame: the frame of ``position`` and ``rotation``; see `Solid`.
        rotation: (3, 3); None if any rotation will do.
        position_tolerance: m.
        angle_tolerance: rad.
    """

    link: str
    frame: str
    position: Floats
    rotation: Floats | None
    position_tolerance: float
    angle_tolerance: float
    where: str


@dataclass(frozen=True, eq=False)
class Scene:
    """All that a file says, or several files together. None and empty collections: it says nothing of that.

    Attributes:
        solids: what stands still.
        attached: what moves with a link.
        values: the robot's state: joints to rad or m.
        base: the place of the robot's root in the world, (4, 4).
        frames: further frames: name to parent and place in the parent, (4, 4).
        model: the robot's name.
        group: the group of joints that move.
        joints: the joints that move, in their order.
        goals: configurations; any of them is a goal. Joints to rad or m.
        pose: the goal as a pose.
        notes: what was left out, one line each.
    """

    solids: list[Solid] = field(default_factory=list)
    attached: list[Attached] = field(default_factory=list)
    values: dict[str, float] = field(default_factory=dict)
    base: Floats | None = None
    frames: Mapping[str, tuple[str, Floats]] = field(default_factory=dict)
    model: str | None = None
    group: str | None = None
    joints: list[str] | None = None
    goals: list[dict[str, float]] = field(default_factory=list)
    pose: PoseGoal | None = None
    notes: list[str] = field(default_factory=list)

    def joined(self, other: Scene) -> Scene:
        """Return what both say; where both say something of one joint or frame, or hold one value, ``other`` counts."""
        merged: dict[str, Any] = {}
        for each in fields(self):
            one, two = getattr(self, each.name), getattr(other, each.name)
            if isinstance(one, Mapping):
                merged[each.name] = {**one, **two}
            elif isinstance(one, list) and each.name != "joints":
                merged[each.name] = one + two
            else:
                merged[each.name] = one if two is None else two
        return Scene(**merged)
