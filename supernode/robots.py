"""Robots and their problems in Python: `load_robot`, solids, and a function for each kind of problem.

The functions are named like the kinds' tables, and return checked problems, which `solve` and `simulate` take. Numpy
arrays may stand wherever lists of numbers may.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from pydantic import BaseModel, ValidationError

from problems.errors import BadInput, first_line
from problems.problem import Problem
from problems.registry import find_registered
from problems.robots import fields as tables
from problems.robots.fields import Robot
from problems.robots.loading import EXTRA, gather_description, robots_of_extra
from problems.robots.making import read_parts

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

Made = TypeVar("Made", bound=BaseModel)


def load_robot(
    robot: str | Path,
    *,
    srdf: str | Path | None = None,
    packages: Sequence[str | Path] | None = None,
    group: str | None = None,
    joints: Sequence[str] | None = None,
    fixed: Mapping[str, float] | None = None,
    acceleration: float | Sequence[float] | None = None,
    base: Mapping[str, Any] | None = None,
) -> Robot:
    """Read a robot with its meshes once, for any number of problems; nothing opens its files later.

    ::

        robot = supernode.load_robot("example-robot-data:panda", group="arm")

    Args:
        robot: a URDF file, or ``example-robot-data:NAME``, or the NAME alone.
        srdf: its groups and pairs that may touch; by default the one beside a robot of example-robot-data.
        packages: folders where ``package://`` looks; by default the URDF's folder and those above it.
        group: a group of the SRDF, whose joints move.
        joints: the joints that move, in place of a group; by default all.
        fixed: where other joints stand, rad or m; by default 0, or the nearest limit.
        acceleration: the limit of each joint, rad/s² or m/s², or one for all; used where motions get times.
        base: where the root of the robot stands: ``{"position": [x, y, z], "quaternion": [x, y, z, w]}``.

    Raises:
        BadInput: if a file cannot be read or a field is wrong; one line that names it and what was expected.
    """
    if not isinstance(robot, str | Path):
        raise BadInput(f"robot: expected a file or a name, found {type(robot).__name__}")
    for field, names in (("joints", joints), ("packages", packages)):
        if isinstance(names, str):
            raise BadInput(f"{field}: expected a list, found the text {names!r}")
    name = str(robot)
    if not Path(name).is_file() and name in robots_of_extra():
        name = f"{EXTRA}:{name}"
    given = {
        "urdf": name,
        "srdf": None if srdf is None else str(srdf),
        "packages": None if packages is None else [str(each) for each in packages],
        "group": group,
        "joints": None if joints is None else list(joints),
        "fixed": None if fixed is None else dict(fixed),
        "acceleration": acceleration,
        "base": base,
    }
    described = {field: _plain(value) for field, value in given.items() if value is not None}
    loaded = _made(Robot, gather_description(described, Path()), "load_robot")
    read_parts(loaded)  # refuses a group or a joint that the robot does not have
    return loaded


# Solids ---------------------------------------------------------------------------------------------------------------
# Each moves with a link if one is given, and stands still otherwise.
def Box(*, size: ArrayLike, **fields: Any) -> tables.BoxObstacle | tables.AttachedBox:  # noqa: N802
    """Return a box about its centre.

    Args:
        size: full lengths along x, y and z, m.
        fields: ``id``, a name for messages; ``position``, m; ``quaternion``, x, y, z, w; ``link``, with which it
            moves, and ``may_touch``, names of links.
    """
    given = {"shape": "box", "size": size} | fields
    if "link" in fields:
        return _made(tables.AttachedBox, given, "Box")
    return _made(tables.BoxObstacle, given, "Box")


def Cylinder(  # noqa: N802
    *, radius: float, length: float, **fields: Any
) -> tables.CylinderObstacle | tables.AttachedCylinder:
    """Return a cylinder about its centre, along its z axis; lengths in m. See `Box` for ``fields``."""
    given = {"shape": "cylinder", "radius": radius, "length": length} | fields
    if "link" in fields:
        return _made(tables.AttachedCylinder, given, "Cylinder")
    return _made(tables.CylinderObstacle, given, "Cylinder")


def Sphere(*, radius: float, **fields: Any) -> tables.SphereObstacle | tables.AttachedSphere:  # noqa: N802
    """Return a sphere about its centre; radius in m. See `Box` for ``fields``."""
    given = {"shape": "sphere", "radius": radius} | fields
    if "link" in fields:
        return _made(tables.AttachedSphere, given, "Sphere")
    return _made(tables.SphereObstacle, given, "Sphere")


def Mesh(*, file: str | Path, **fields: Any) -> tables.MeshObstacle | tables.AttachedMesh:  # noqa: N802
    """Return a triangle mesh from an STL, OBJ or DAE file, relative to the current folder.

    The problem that gets it reads the file. See `Box` for ``fields``; besides, ``scale`` is one factor or three.
    """
    given = {"shape": "mesh", "file": str(file)} | fields
    if "link" in fields:
        return _made(tables.AttachedMesh, given, "Mesh")
    return _made(tables.MeshObstacle, given, "Mesh")


# Problems -------------------------------------------------------------------------------------------------------------
def RobotPath(*, robot: Robot, start: ArrayLike, **fields: Any) -> Problem:  # noqa: N802
    """Return the problem of a short path among obstacles; see `supernode problems robot-path` for all fields.

    ::

        problem = supernode.RobotPath(robot=robot, start=home, goal=there, obstacles=[supernode.Box(size=[1, 1, 0.1])])
        print(supernode.solve(problem, seconds=1).path)

    Args:
        robot: from `load_robot`.
        start: where the robot stands, in the order of its joints, rad or m.
        fields: ``goal``, ``goals`` or ``goal_pose``; ``obstacles`` and ``attached``, lists of solids; ``clearance``, m.

    Raises:
        BadInput: if a field is wrong, or the robot touches something at its start or goal.
    """
    return _problem("robot-path", {"robot": robot, "start": start} | fields)


def RobotIk(*, robot: Robot, **fields: Any) -> Problem:  # noqa: N802
    """Return the problem of a configuration in which a link has a pose; see `supernode problems robot-ik`.

    Args:
        robot: from `load_robot`.
        fields: ``goal_pose``, such as ``{"link": "panda_hand", "position": [0.4, 0.1, 0.5]}``; ``obstacles`` and
            ``attached``, lists of solids; ``clearance``, m.

    Raises:
        BadInput: if a field is wrong.
    """
    return _problem("robot-ik", {"robot": robot} | fields)


def _problem(kind: str, given: dict[str, Any]) -> Problem:
    """Return a problem of a built-in kind, made in the same steps as one of a file."""
    model = find_registered(kind)
    fields = {"kind": kind} | {name: _plain(value) for name, value in given.items()}
    return _made(model, model.derive_fields(model.gather(fields, Path())), model.__name__)


def _made(model: type[Made], fields: dict[str, Any], where: str) -> Made:
    try:
        return model.model_validate({name: _plain(value) for name, value in fields.items()})
    except ValidationError as error:
        raise first_line(error, model, where) from None


def _plain(value: Any) -> Any:
    """Return a value as a problem file has it: tables as dicts, arrays as lists."""
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json", exclude_unset=True)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return value
