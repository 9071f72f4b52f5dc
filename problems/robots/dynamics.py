"""The torques that a motion needs, by pinocchio from the masses and inertias of the URDF.

Only what retimes and checks motions imports this module. Friction, rotors and attached things have no part in it, as
neither a URDF nor a problem file says what they weigh.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.robots.fields import Robot
from problems.robots.scenery import Way, standing, way_of
from problems.robots.urdf import Urdf, read_urdf

Floats = NDArray[np.float64]

GRAVITY = 9.81  # m/s², along -z of the world
_LEAST_INERTIA = 1e-9  # kg m² or kg: a joint that moves less has nothing heavy beyond it


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Inverse dynamics of a robot's variables; joints that follow others move with them, and the rest stand still.

    Attributes:
        model: pinocchio's model of the joints that move.
        data: its working memory. Not thread-safe.
        places: the first entry of each of the model's joints in its configuration, and how many it has.
        factors: the values of the model's joints are ``factors @ q + offsets``, shape (joints of the model, n).
        offsets: see ``factors``.
    """

    pinocchio: Any
    model: Any
    data: Any
    places: tuple[tuple[int, int], ...]
    factors: Floats
    offsets: Floats

    @staticmethod
    def of(robot: Robot, joints: Sequence[str]) -> Dynamics | None:
        """Return the dynamics of a robot; None if the URDF states no mass beyond some joint.

        Args:
            robot: the robot, loaded.
            joints: the variables, in the order of configurations.

        Raises:
            BadInput: if pinocchio is not installed.
        """
        try:
            import pinocchio
        except ImportError as error:
            raise BadInput(
                "--retime: torques need pinocchio, which is not installed: pip install 'supernode[robots]'"
            ) from error
        urdf = read_urdf(robot.urdf)
        whole = pinocchio.buildModelFromXML(robot.urdf)
        ways = {name: way_of(urdf, urdf.joints[name]) for name in whole.names[1:]}
        welded = [name for name in whole.names[1:] if ways[name].joint not in joints]
        reference = _configuration(whole, {name: _value(robot, urdf, ways[name]) for name in welded})
        model = pinocchio.buildReducedModel(whole, [whole.getJointId(name) for name in welded], reference)
        # Gravity in the frame of the root link, which may be tilted.
        model.gravity.linear = robot.base.placement.reshape(3, 4)[:, :3].T @ np.array([0.0, 0.0, -GRAVITY])
        factors = np.zeros((model.njoints - 1, len(joints)))
        for row, name in enumerate(model.names[1:]):
            factors[row, list(joints).index(ways[name].joint)] = ways[name].multiplier
        made = Dynamics(
            pinocchio,
            model,
            model.createData(),
            tuple((joint.idx_q, joint.nq) for joint in list(model.joints)[1:]),
            factors,
            np.array([ways[name].offset for name in model.names[1:]]),
        )
        return made if made._is_heavy() else None

    def torques(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the torques of the variables, N m (N for prismatic joints): shapes (n,) to (n,)."""
        values = _of_values(self.places, self.model.nq, self.factors @ q + self.offsets)
        moved = self.pinocchio.rnea(self.model, self.data, values, self.factors @ qd, self.factors @ qdd)
        torques: Floats = self.factors.T @ moved
        return torques

    def along(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return `torques` of many moments, shapes (m, n)."""
        return np.array([self.torques(*row) for row in zip(q, qd, qdd, strict=True)]).reshape(q.shape)

    def _is_heavy(self) -> bool:
        """Return whether every variable moves some mass, wherever the robot stands."""
        n = self.factors.shape[1]
        middle, rest = np.full(n, 0.1), np.zeros(n)
        pull = self.torques(middle, rest, rest)
        inertias = [(self.torques(middle, rest, one) - pull)[number] for number, one in enumerate(np.eye(n))]
        return bool(min(inertias) > _LEAST_INERTIA)


def _value(robot: Robot, urdf: Urdf, way: Way) -> float:
    """Return where a joint stands that does not move here."""
    return way.multiplier * standing(robot, urdf, way.joint) + way.offset


def _configuration(model: Any, values: Mapping[str, float]) -> Floats:
    """Return a configuration of pinocchio with the named joints at their values and the others at 0."""
    places = tuple((joint.idx_q, joint.nq) for joint in list(model.joints)[1:])
    return _of_values(places, model.nq, np.array([values.get(name, 0.0) for name in model.names[1:]]))


def _of_values(places: Sequence[tuple[int, int]], size: int, values: Floats) -> Floats:
    """Return pinocchio's configuration, in which a continuous joint is a cosine and a sine."""
    found = np.empty(size)
    for (first, count), value in zip(places, values, strict=True):
        found[first : first + count] = value if count == 1 else (np.cos(value), np.sin(value))
    return found
