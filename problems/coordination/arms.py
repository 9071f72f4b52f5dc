"""Arms on paths, their kinematics, and their coordination diagram, which python-fcl computes (§4).

An arm is a chain of revolute joints with Denavit–Hartenberg parameters. Its links are capsules between the origins of
the frames. It follows straight lines in joint space at one path speed: the highest at which no joint exceeds its own
greatest speed.
"""

from __future__ import annotations

import json
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from problems.angles import Angle
from problems.coordination.diagram import Diagram, Mask
from problems.errors import BadInput, shorten
from problems.tables import Table, quantity

Floats = NDArray[np.float64]
Metres = Annotated[float, Field(ge=-1e3, le=1e3)]
Speed = Annotated[float, Field(gt=0, le=1e6)]
Configuration = Annotated[list[Angle], Field(min_length=1, max_length=20)]
Cells = Annotated[int, Field(ge=2, le=2000)]

_SCORBOT_SPEEDS = [0.349, 0.459, 0.459, 1.449, 1.85]  # 20, 26.3, 26.3, 83, 106 °/s
_RIGHT_ANGLE = float(np.pi / 2.0)
_STRAIGHT = 1e-9  # two directions count as equal if their unit vectors differ by no more


class Robot(Table):
    """An arm and its path. The default arm resembles a SCORBOT."""

    path: list[Configuration] | None = quantity(
        "rad", "joint angles at the corners of the path, at least two; unwrapped, straight in between", default=None
    )
    result: str | None = quantity(
        "", "instead of path, a file with an arm-path result, relative to the problem file", default=None
    )
    cells: Cells = quantity("cells", "into how many equal stretches the path is divided", default=180)
    base: tuple[Metres, Metres, Metres, Angle] = quantity(
        "m, m, m, rad", "where the first joint stands: [x, y, z, heading]", default=(0.0, 0.0, 0.0, 0.0)
    )
    d: list[Metres] = quantity("m", "offset of each joint, along its axis", default=[0.349, 0.0, 0.0, 0.0, 0.145])
    a: list[Metres] = quantity("m", "length of each joint, to the next axis", default=[0.016, 0.221, 0.221, 0.0, 0.0])
    alpha: list[Angle] = quantity(
        "rad", "angle from each joint's axis to the next", default=[_RIGHT_ANGLE, 0.0, 0.0, _RIGHT_ANGLE, 0.0]
    )
    speeds: list[Speed] = quantity("rad/s", "the greatest speed of each joint", default=_SCORBOT_SPEEDS)
    acceleration: float = quantity("s", "time to reach the path's speed", default=0.2, ge=0, le=1e6)
    radius: float = quantity("m", "half the thickness of a link", default=0.04, gt=0, le=1e3)

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if self.path is None:
            found = "neither" if self.result is None else f"only the name {shorten(self.result)}"
            raise ValueError(f"expected a path, or a result that was read with the problem file, found {found}")
        if len(self.path) < 2:
            raise ValueError(f"path: expected at least 2 configurations, found {len(self.path)}")
        joints = len(self.path[0])
        for name, values in (("d", self.d), ("a", self.a), ("alpha", self.alpha), ("speeds", self.speeds)):
            if len(values) != joints:
                raise ValueError(f"{name}: expected {joints} numbers, as in the path, found {len(values)}")
        for number, configuration in enumerate(self.path):
            if len(configuration) != joints:
                raise ValueError(f"path[{number}]: expected {joints} angles, found {len(configuration)}")
        return self

    @property
    def lengths(self) -> Floats:
        """The lengths of the capsules' axes, m, shape (joints,); 0 where two frames share an origin."""
        return np.hypot(self.d, self.a)


class Motion:
    """An arm's path as a function of λ, the length along it in joint space, rad."""

    def __init__(self, robot: Robot) -> None:
        assert robot.path is not None, "a robot's path is known once it is validated"
        self.corners = np.array(robot.path)
        self._at = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.corners, axis=0), axis=1))])
        self.length = float(self._at[-1])

    def configurations(self, where: NDArray[Any]) -> Floats:
        """Return the joint angles at some values of λ: (n,) to (n, joints)."""
        return self._along(self.corners, where)

    def directions(self, where: NDArray[Any]) -> Floats:
        """Return the derivatives of the joint angles by λ, from the right: (n,) to (n, joints)."""
        lengths = np.diff(self._at)[:, None]
        steps = np.diff(self.corners, axis=0)
        slopes = np.divide(steps, lengths, out=np.zeros(steps.shape), where=lengths > 0.0)
        stretch = np.searchsorted(self._at, where, side="right") - 1
        return slopes[np.minimum(stretch, len(slopes) - 1)]

    def turned(self, where: NDArray[Any]) -> Floats:
        """Return the sum of each joint's turns, in both senses, up to some values of λ, rad: (n,) to (n, joints)."""
        steps = np.abs(np.diff(self.corners, axis=0))
        return self._along(np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)]), where)

    def speed(self, limits: Floats) -> float:
        """Return the highest path speed at which no joint exceeds its limit, rad/s; inf if nothing moves."""
        steps = np.diff(self.corners, axis=0)
        lengths = np.linalg.norm(steps, axis=1, keepdims=True)
        moving = np.abs(steps) > 0.0
        allowed = np.divide(limits * lengths, np.abs(steps), out=np.full(steps.shape, np.inf), where=moving)
        return float(allowed.min())

    def _along(self, values: Floats, where: NDArray[Any]) -> Floats:
        return np.column_stack([np.interp(where, self._at, column) for column in values.T])


def diagram(first: Robot, second: Robot, clearance: float = 0.0) -> Diagram:
    """Return the coordination diagram of two arms whose links must keep a clearance, m, from each other.

    A cell may be free only if every point in it is (§2). Each capsule is therefore tested at the middle of its stretch,
    thickened by the farthest that any of its points moves within the stretch.
    """
    # To thicken one of the two arms by the clearance is enough.
    times = (_times(first), _times(second))
    return Diagram.of(_colliding(_capsules(first, clearance), _capsules(second)), times)


def _times(robot: Robot) -> tuple[float, float]:
    """Return the seconds per cell at the path's speed, and the seconds to reach that speed."""
    motion = Motion(robot)
    per_cell = motion.length / (robot.cells - 1) / motion.speed(np.array(robot.speeds))
    return per_cell, robot.acceleration


def places(robot: Robot, indices: NDArray[Any]) -> Floats:
    """Return the joint angles at cells, or at fractions between them: (n,) to (n, joints)."""
    motion = Motion(robot)
    return motion.configurations(indices * motion.length / (robot.cells - 1))


def directions(robot: Robot, indices: NDArray[Any]) -> Floats:
    """Return how much each joint turns per cell from some places on, rad: (n,) to (n, joints)."""
    motion = Motion(robot)
    cell = motion.length / (robot.cells - 1)
    return motion.directions(indices * cell) * cell


def corners(robot: Robot) -> Floats:
    """Return the places along an arm's path, in cells, at which its direction in joint space changes; increasing."""
    motion = Motion(robot)
    if motion.length == 0.0:
        return np.empty(0)
    at = np.linalg.norm(np.diff(motion.corners, axis=0), axis=1)
    ends, moving = np.cumsum(at), np.flatnonzero(at > 0.0)
    ways = np.diff(motion.corners, axis=0)[moving] / at[moving, None]
    turns = np.linalg.norm(np.diff(ways, axis=0), axis=1) > _STRAIGHT
    found: Floats = ends[moving[:-1][turns]] * (robot.cells - 1) / motion.length
    return found


def origins(robot: Robot, configurations: Floats) -> Floats:
    """Return the origins of the arm's frames, the base first: (n, joints), rad, to (n, joints + 1, 3), m."""
    count, joints = configurations.shape
    x, y, z, heading = robot.base
    turn, at = _about_z(np.full(count, heading)), np.tile([x, y, z], (count, 1))
    found = [at]
    for joint in range(joints):
        turn = turn @ _about_z(configurations[:, joint])
        at = at + turn @ [robot.a[joint], 0.0, robot.d[joint]]
        turn = turn @ _about_x(robot.alpha[joint])
        found.append(at)
    return np.stack(found, axis=1)


def _about_z(angles: Floats) -> Floats:
    """Return rotation matrices about z, shape (n, 3, 3)."""
    matrices = np.zeros((len(angles), 3, 3))
    matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(angles)
    matrices[:, 1, 0] = np.sin(angles)
    matrices[:, 0, 1] = -matrices[:, 1, 0]
    matrices[:, 2, 2] = 1.0
    return matrices


def _about_x(angle: float) -> Floats:
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def _capsules(robot: Robot, clearance: float = 0.0) -> list[list[Any]]:
    """Return the capsules of each cell as collision objects, thickened by their sweep and a clearance, m."""
    import fcl

    ends = origins(robot, places(robot, np.arange(robot.cells)))
    radii = robot.radius + clearance + _sweeps(robot)
    links = np.flatnonzero(robot.lengths > 0.0)
    return [
        [
            fcl.CollisionObject(
                fcl.Capsule(radii[cell, link], robot.lengths[link]),
                fcl.Transform(
                    _upright(ends[cell, link + 1] - ends[cell, link]), ends[cell, link : link + 2].mean(axis=0)
                ),
            )
            for link in links
        ]
        for cell in range(robot.cells)
    ]


def _sweeps(robot: Robot) -> Floats:
    """Return bounds of how far any point of a capsule moves within half a stretch, m, shape (cells, joints).

    A joint's turn moves a point by at most the angle times the point's distance from the joint's axis. The total length
    of the links between bounds that distance.
    """
    motion = Motion(robot)
    step = motion.length / (robot.cells - 1)
    cells = np.arange(robot.cells)
    before, here, after = (motion.turned(step * (cells + shift)) for shift in (-0.5, 0.0, 0.5))
    turns = np.maximum(here - before, after - here)  # the path may have a corner in either half
    upto = np.cumsum(robot.lengths)
    reach = upto[None, :] - np.concatenate([[0.0], upto[:-1]])[:, None]  # (turning joint, capsule)
    sweeps: Floats = turns @ np.triu(reach)
    return sweeps


def _upright(axis: Floats) -> Floats:
    """Return a rotation matrix that turns +z to a direction."""
    z = axis / np.linalg.norm(axis)
    aside = np.eye(3)[np.argmin(np.abs(z))]  # far from parallel to z, so that the cross product is well conditioned
    x = np.cross(aside, z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def _colliding(first: list[list[Any]], second: list[list[Any]]) -> Mask:
    """Return which cells of the first arm collide with which cells of the second."""
    import fcl

    def manager(objects: list[Any]) -> Any:
        made = fcl.DynamicAABBTreeCollisionManager()
        made.registerObjects(objects)
        made.setup()
        return made

    ones, others = [manager(each) for each in first], [manager(each) for each in second]
    blocked = np.zeros((len(ones), len(others)), np.bool_)
    for (i, one), (j, other) in product(enumerate(ones), enumerate(others)):
        data = fcl.CollisionData()
        one.collide(other, data, fcl.defaultCollisionCallback)
        blocked[i, j] = data.result.is_collision
    return blocked


def path_of_result(name: str, folder: Path) -> list[list[float]]:
    """Read the path of an arm-path result, or of its solution alone, from a file.

    Its values are not validated here.

    Raises:
        BadInput: if the file cannot be read, or holds no path.
    """
    try:
        found = json.loads((folder / name).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise BadInput(f"expected an arm-path result as JSON, found {name}: {error}") from None
    if isinstance(found, dict) and isinstance(found.get("solution"), dict):
        found = found["solution"]
    if not (isinstance(found, dict) and isinstance(found.get("path"), list)):
        raise BadInput(f"expected an arm-path result with a path, found {name}: {shorten(found)}")
    path: list[list[float]] = found["path"]
    return path
