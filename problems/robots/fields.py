"""The tables of a robot's problem file: ``[robot]``, ``[[obstacles]]``, ``[[attached]]`` and ``[goal_pose]``.

A loaded problem holds no names of files: `problems.robots.loading` has replaced them by what the files hold.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, Field, field_validator, model_validator

from problems.tables import Table, derived, quantity

Floats = NDArray[np.float64]
Metres = Annotated[float, Field(ge=-1e4, le=1e4)]
Positive = Annotated[float, Field(gt=0, le=1e4)]
Factor = Annotated[float, Field(ge=-1e6, le=1e6)]
Position = tuple[Metres, Metres, Metres]

_MOST_OFF = 0.01  # by which the length of a quaternion may differ from 1: files round to two or three digits


def _unit(quaternion: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
    length = float(np.sqrt(sum(each * each for each in quaternion)))
    if abs(length - 1.0) > _MOST_OFF:
        raise ValueError(
            f"expected a unit quaternion [x, y, z, w], found {list(quaternion)} of length {length:.4g}; "
            "no turn is [0, 0, 0, 1]"
        )
    return quaternion


Quaternion = Annotated[
    tuple[
        Annotated[float, Field(ge=-2, le=2)],
        Annotated[float, Field(ge=-2, le=2)],
        Annotated[float, Field(ge=-2, le=2)],
        Annotated[float, Field(ge=-2, le=2)],
    ],
    AfterValidator(_unit),
]
"""x, y, z, w; of length 1 but for rounding, which is mended where it is used."""


def rotation_of(quaternion: tuple[float, float, float, float]) -> Floats:
    """Return the rotation matrix of a quaternion x, y, z, w, which is made a unit quaternion first."""
    length = np.sqrt(sum(each * each for each in quaternion))
    x, y, z, w = (each / length for each in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


class Placed(Table):
    """A table with a place in space."""

    position: Position = quantity("m", "x, y, z of the centre", default=(0.0, 0.0, 0.0))
    quaternion: Quaternion = quantity("", "its rotation x, y, z, w", default=(0.0, 0.0, 0.0, 1.0))

    @property
    def placement(self) -> Floats:
        """The place as a row-major 3×4 matrix, shape (12,)."""
        turn = rotation_of(self.quaternion)
        placement: Floats = np.concatenate([turn, np.array(self.position)[:, None]], axis=1).reshape(12)
        return placement


class Robot(Table):
    """A robot described by a URDF.

    In a loaded problem ``urdf`` and ``srdf`` are XML texts, ``meshes`` holds the files that they name, and ``packages``
    is not there.
    """

    urdf: str = quantity(
        "", "a URDF: a file, relative to this one, or example-robot-data:NAME (`supernode robots` lists them)"
    )
    srdf: str | None = quantity(
        "",
        "groups of joints, and pairs of links that may touch: a file, or example-robot-data:NAME; by default the SRDF "
        "of a robot of example-robot-data, and pairs found by sampling for others",
        default=None,
    )
    packages: list[str] | None = quantity(
        "", "folders where package:// looks; by default the URDF's folder and those above it", default=None
    )
    group: str | None = quantity("", "a group of the SRDF, whose joints move", default=None)
    joints: list[str] | None = quantity(
        "", "the joints that move, in the order of configurations; by default all of the group or of the URDF",
        default=None,
        min_length=1,
        max_length=64,
    )  # fmt: skip
    fixed: dict[str, Factor] = quantity(
        "", "where other joints stand, rad (or unit) or m; by default 0, or the nearest limit", default_factory=dict
    )
    acceleration: Positive | Annotated[list[Positive], Field(min_length=1, max_length=64)] | None = quantity(
        "rad/s²",
        "the limit of each joint's acceleration, m/s² for prismatic ones, or one for all; used where motions get times",
        default=None,
    )
    base: Placed = quantity("", "where the root of the robot stands", default_factory=Placed)
    meshes: dict[str, str] = derived("the meshes that the URDF and obstacles name", default_factory=dict)

    @field_validator("urdf", "srdf")
    @classmethod
    def _is_text(cls, text: str | None) -> str | None:
        if text is not None and "<" not in text:
            raise ValueError(f"expected a robot loaded from a problem file, which reads the file, found {text!r}")
        return text

    @model_validator(mode="after")
    def _one_choice_of_joints(self) -> Self:
        if self.group is not None and self.joints is not None:
            raise ValueError("joints: expected either group or joints, found both; leave one of them out")
        if self.group is not None and self.srdf is None:
            raise ValueError(
                f"group: expected an srdf that says what {self.group!r} is, found none; give srdf, or joints in place "
                "of the group"
            )
        if self.joints is not None and len(set(self.joints)) < len(self.joints):
            twice = next(name for name in self.joints if self.joints.count(name) > 1)
            raise ValueError(f"joints: expected different joints, found {twice!r} more than once")
        return self


class Box(Placed):
    """A box about its centre."""

    shape: Literal["box"]
    size: tuple[Positive, Positive, Positive] = quantity("m", "full lengths along its x, y and z")


class Cylinder(Placed):
    """A cylinder about its centre, along its z axis."""

    shape: Literal["cylinder"]
    radius: Positive = quantity("m", "its radius")
    length: Positive = quantity("m", "its length along z")


class Sphere(Placed):
    """A sphere about its centre."""

    shape: Literal["sphere"]
    radius: Positive = quantity("m", "its radius")


class MeshShape(Placed):
    """A triangle mesh from a file, in the file's own frame."""

    shape: Literal["mesh"]
    file: str = quantity("", "an STL, OBJ or DAE file, relative to this one", min_length=1)
    scale: Annotated[list[Factor], Field(min_length=3, max_length=3)] = quantity(
        "", "factors of x, y and z, or one for all", default=[1.0, 1.0, 1.0]
    )

    @field_validator("scale", mode="before")
    @classmethod
    def _one_or_three(cls, scale: Any) -> Any:
        return [scale] * 3 if isinstance(scale, int | float) and not isinstance(scale, bool) else scale

    @field_validator("scale")
    @classmethod
    def _not_flat(cls, scale: list[float]) -> list[float]:
        if not all(scale):
            raise ValueError(f"expected factors other than 0, found {scale}")
        return scale


class _Named(Table):
    id: str | None = quantity("", "a name for messages", default=None)


class _Attached(_Named):
    link: str = quantity("", "the link with which it moves; position and quaternion are in its frame")
    may_touch: list[str] = quantity(
        "",
        "links, or names of mesh obstacles, that it may touch, besides those that move with it",
        default_factory=list,
    )


class BoxObstacle(_Named, Box):
    """A box that stands still."""


class CylinderObstacle(_Named, Cylinder):
    """A cylinder that stands still."""


class SphereObstacle(_Named, Sphere):
    """A sphere that stands still."""


class MeshObstacle(_Named, MeshShape):
    """A mesh that stands still."""


class AttachedBox(_Attached, Box):
    """A box that moves with a link."""


class AttachedCylinder(_Attached, Cylinder):
    """A cylinder that moves with a link."""


class AttachedSphere(_Attached, Sphere):
    """A sphere that moves with a link."""


class AttachedMesh(_Attached, MeshShape):
    """A mesh that moves with a link."""


Shape = Box | Cylinder | Sphere | MeshShape
Obstacle = Annotated[BoxObstacle | CylinderObstacle | SphereObstacle | MeshObstacle, Field(discriminator="shape")]
Attached = Annotated[AttachedBox | AttachedCylinder | AttachedSphere | AttachedMesh, Field(discriminator="shape")]


def name_of(table: _Named, field: str, number: int) -> str:
    """Return the name of an obstacle or attached thing for messages: its id, or its place such as ``obstacles[2]``."""
    return table.id if table.id is not None else f"{field}[{number}]"


class GoalPose(Table):
    """A pose that a link shall reach."""

    link: str = quantity("", "the link whose frame shall reach the pose")
    position: Position = quantity("m", "x, y, z in the world")
    quaternion: Quaternion | None = quantity(
        "", "rotation x, y, z, w in the world; any rotation will do if not given", default=None
    )
    position_tolerance: float = quantity("m", "the most by which the position may differ", default=1e-4, gt=0, le=1.0)
    angle_tolerance: float = quantity(
        "rad", "the most by which the rotation may differ", default=1e-3, gt=0, le=3.141592653589793
    )
