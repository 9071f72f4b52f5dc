"""Arms as a problem file describes them: uniform rods in a plane, or a chain of bodies read from a URDF."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from problems.tables import Table, quantity

Positive = Annotated[float, Field(gt=0, le=1e6)]
Finite = Annotated[float, Field(ge=-1e6, le=1e6)]
Triple = tuple[Finite, Finite, Finite]
Matrix = tuple[Triple, Triple, Triple]
Floats = NDArray[np.float64]

EARTH = 9.81  # m/s²

LIMITS = {"torque": "N m", "velocity": "rad/s", "acceleration": "rad/s²", "jerk": "rad/s³"}
"""The quantities of a joint that may be limited: names of fields of `Arm`, and their units."""


class Body(Table):
    """A revolute joint and the body that it turns, both in the joint's frame."""

    name: str = quantity("", "the joint's name")
    rotation: Matrix = quantity("", "rotation of the joint's frame in the frame before it")
    place: Triple = quantity("m", "position of the joint in the frame before it")
    axis: Triple = quantity("", "unit vector about which the joint turns")
    mass: float = quantity("kg", "mass of the body", ge=0, le=1e6)
    centre: Triple = quantity("m", "centre of mass")
    inertia: Matrix = quantity("kg m²", "inertia about the centre of mass")
    limits: tuple[Finite, Finite] | None = quantity("rad", "[lowest, highest] angle", default=None)


class Arm(Table):
    """A serial arm of revolute joints, described by masses and lengths of rods or by a URDF.

    A loaded problem never holds ``urdf`` or ``joints``: `MinTime.gather` has replaced them with ``bodies``, so that
    nodes need neither the file nor pinocchio.
    """

    masses: list[Positive] | None = quantity(
        "kg", "masses of uniform rods in a plane, from the base outwards", default=None
    )
    lengths: list[Positive] | None = quantity("m", "lengths of the rods", default=None)
    tip_mass: float = quantity("kg", "a point mass at the end of the last rod", default=0.0, ge=0, le=1e6)
    urdf: str | None = quantity(
        "",
        "a URDF instead of rods: a file beside this one, or example-robot-data:FOLDER/urdf/FILE from that package",
        default=None,
    )
    joints: list[str] | None = quantity(
        "", "which joints of the URDF move, from the base outwards; if not given, all revolute ones", default=None
    )
    bodies: list[Body] | None = quantity("", "joints and links, which replace the URDF when loaded", default=None)
    gravity: float | None = quantity(
        "m/s²", "downwards: along -y for rods (0 if not given), along -z for a URDF (9.81)", default=None, ge=0, le=1e3
    )
    torque: list[Positive] | None = quantity(
        "N m", "torque limits, one a joint; if not given, the URDF's", default=None, min_length=1, max_length=64
    )
    velocity: list[Positive] | None = quantity(
        "rad/s",
        "velocity limits, one a joint; if not given, those of the URDF; none for rods",
        default=None,
        min_length=1,
        max_length=64,
    )
    acceleration: list[Positive] | None = quantity(
        "rad/s²", "acceleration limits, one a joint; none if not given", default=None, min_length=1, max_length=64
    )
    jerk: list[Positive] | None = quantity(
        "rad/s³", "jerk limits, one a joint; none if not given", default=None, min_length=1, max_length=64
    )

    @model_validator(mode="after")
    def _one_description(self) -> Self:
        rods = self.masses is not None or self.lengths is not None
        if self.urdf is not None:
            raise ValueError(
                f"urdf: expected an arm loaded from a problem file, which reads the URDF, found the name {self.urdf!r}"
            )
        if rods == (self.bodies is not None):
            raise ValueError(f"expected either masses and lengths or urdf, found {'both' if rods else 'neither'}")
        if rods and len(self.masses or []) != len(self.lengths or []):
            raise ValueError(
                f"expected as many masses as lengths, found {len(self.masses or [])} and {len(self.lengths or [])}"
            )
        if self.size == 0:
            raise ValueError("expected at least one joint, found none")
        # Checked for rods and URDFs alike: reading a URDF fills in its limits before the model is made.
        if self.torque is None:
            raise ValueError(f"torque: expected one limit for each of {self.size} joints, found none")
        for name in LIMITS:
            values = getattr(self, name)
            if values is not None and len(values) != self.size:
                raise ValueError(f"{name}: expected one limit for each of {self.size} joints, found {len(values)}")
        return self

    @property
    def size(self) -> int:
        """The number of joints."""
        return len(self.bodies if self.bodies is not None else self.masses or [])

    @property
    def is_planar(self) -> bool:
        """Whether the arm consists of rods in a plane."""
        return self.bodies is None

    @property
    def names(self) -> list[str]:
        """The names of the joints, from the base outwards."""
        return [body.name for body in self.chain]

    def limit_of(self, name: str) -> Floats:
        """Return the limits of one of the quantities of `LIMITS`, shape (joints,); inf where there is no limit."""
        values = getattr(self, name)
        return np.full(self.size, np.inf) if values is None else np.array(values)

    @property
    def falling(self) -> Floats:
        """The acceleration of gravity, m/s², shape (3,)."""
        if self.is_planar:
            return np.array([0.0, -(self.gravity or 0.0), 0.0])
        return np.array([0.0, 0.0, -(EARTH if self.gravity is None else self.gravity)])

    @cached_property
    def chain(self) -> list[Body]:
        """All joints with their bodies, from the base outwards."""
        if self.bodies is not None:
            return self.bodies
        masses, lengths = self.masses or [], self.lengths or []
        return [self._rod(link, masses[link], lengths) for link in range(len(masses))]

    def _rod(self, link: int, mass: float, lengths: list[float]) -> Body:
        # The tip mass is part of the last rod's body. The inertia is that of the rod about its own centre, moved to the
        # common centre of mass by the parallel axis theorem, and that of the point mass.
        length, tip = lengths[link], self.tip_mass if link == len(lengths) - 1 else 0.0
        centre = (mass / 2 + tip) * length / (mass + tip)
        swing = mass * length**2 / 12 + mass * (length / 2 - centre) ** 2 + tip * (length - centre) ** 2
        return Body(
            name=f"joint {link + 1}",
            rotation=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
            place=(lengths[link - 1] if link else 0.0, 0.0, 0.0),
            axis=(0.0, 0.0, 1.0),
            mass=mass + tip,
            centre=(centre, 0.0, 0.0),
            inertia=((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, swing)),
        )

    @property
    def rows(self) -> Floats:
        """The chain as the kernels take it, shape (joints, `problems.min_time.dynamics.COLUMNS`)."""
        return np.array(
            [
                np.concatenate([np.ravel(part) for part in (b.rotation, b.place, b.axis, b.mass, b.centre, b.inertia)])
                for b in self.chain
            ]
        )

    @property
    def two_links(self) -> Floats:
        """The five constants of the closed-form dynamics of two planar links.

        The first three are α, β and δ of the mass matrix [[α + 2β cos q₂, ..], [δ + β cos q₂, δ]], in kg m². The last
        two are the moments of gravity, N·m: the factors of cos q₁ and of cos(q₁ + q₂).
        """
        one, two = self.chain
        # The second joint lies at the end of the first rod, along x of its frame.
        length, gravity = two.place[0], -self.falling[1]
        # The second rod's moment of inertia about its own joint, by the parallel axis theorem.
        own = two.inertia[2][2] + two.mass * two.centre[0] ** 2
        return np.array(
            [
                one.inertia[2][2] + one.mass * one.centre[0] ** 2 + two.mass * length**2 + own,
                two.mass * length * two.centre[0],
                own,
                gravity * (one.mass * one.centre[0] + two.mass * length),
                gravity * two.mass * two.centre[0],
            ]
        )

    def holding_torque(self, angles: list[float]) -> Floats:
        """Return the torques that hold the arm still against gravity, N·m, shape (joints,).

        By virtual work: the torque of a joint is the work of the weights of all bodies beyond it for a unit turn.
        """
        # Forward kinematics from the base outwards: the rotation and position of each joint's frame in the base frame.
        turn, place = np.eye(3), np.zeros(3)
        axes, places, torque = [], [], np.zeros(self.size)
        for angle, body in zip(angles, self.chain, strict=True):
            place = place + turn @ body.place
            turn = turn @ np.array(body.rotation) @ rotation_about(np.array(body.axis), angle)
            axes.append(turn @ body.axis)
            places.append(place)
            arms = place + turn @ body.centre - np.array(places)
            # The weight of this body counts for all joints at or before it.
            torque[: len(axes)] -= np.cross(axes, arms) @ (body.mass * self.falling)
        return torque


def rotation_about(axis: Floats, angle: float) -> Floats:
    """Return the matrix of a rotation about a unit vector, by Rodrigues' formula."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Floats = np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew
    return turn
