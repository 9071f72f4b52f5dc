"""The planar arm and the fields of all problems of planar arms among obstacles."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
import shapely
from numpy.typing import NDArray
from pydantic import Field, ValidationInfo, field_validator, model_validator

from problems.angles import Angle, WithAngles
from problems.plane import CONTACT, Metres, Obstacle
from problems.problem import CodedProblem
from problems.tables import Table, quantity

Length = Annotated[float, Field(gt=0, le=1e6)]
Place = tuple[Metres, Metres]
Configurations = NDArray[np.float64]  # (n, links), rad


class Arm(Table):
    """A planar arm of revolute joints. Joint angle j is relative to link j − 1; at all zeros it lies along +x."""

    links: list[Length] = quantity("m", "lengths from the base outwards, at least one", min_length=1, max_length=100)
    base: Place = quantity("m", "where the first joint stands", default=(0.0, 0.0))
    radius: float = quantity("m", "half the thickness of a link", default=0.0, ge=0, le=1e6)
    limits: list[tuple[Angle, Angle]] | None = quantity(
        "rad", "[lowest, highest] angle of each joint; a full circle [0, 2π) if not given", default=None
    )

    @field_validator("limits")
    @classmethod
    def _one_pair_a_link(
        cls, limits: list[tuple[float, float]] | None, info: ValidationInfo
    ) -> list[tuple[float, float]] | None:
        links = len(info.data.get("links", limits or []))
        if limits is not None and len(limits) != links:
            raise ValueError(f"expected one [lowest, highest] for each of {links} links, found {len(limits)}")
        for joint, (lowest, highest) in enumerate(limits or []):
            if not lowest < highest:
                raise ValueError(f"expected lowest < highest for joint {joint + 1}, found [{lowest}, {highest}]")
        return limits


class ArmProblem(CodedProblem, WithAngles):
    """The common base of all problems of planar arms among obstacles."""

    bits: int = quantity("bit", "bits of each joint angle", default=8, ge=1, le=62)
    clearance: float = quantity(
        "m",
        "least distance of links from obstacles, and from links that are not their neighbours",
        default=0.0,
        ge=0,
        le=1e6,
    )
    self_collision: bool = quantity("", "whether links that are not neighbours must not touch each other", default=True)
    arm: Arm = quantity("", "the arm")
    obstacles: list[Obstacle] = quantity("", "solid shapes that no link may touch", default_factory=list)

    @model_validator(mode="after")
    def _some_configuration_may_be_free(self) -> Self:
        """Refuse arms that collide in every configuration: at the base, or by links too short to keep apart."""
        hit = self._obstacle_at_base()
        if hit is not None:
            raise ValueError(
                f"arm.base: expected a place clear of the obstacles by the arm's radius {self.arm.radius:g}"
                f"{self._and_clearance}, found {list(self.arm.base)} in obstacles[{hit}]"
            )
        shortest = min(self.arm.links[1:-1], default=np.inf)
        if self.self_collision and shortest < self.apart:
            raise ValueError(
                f"arm.links: expected inner links at least as long as twice the radius {self.arm.radius:g}"
                f"{self._and_clearance}, as the links on either side would always touch, found {shortest:g}"
            )
        return self

    def _obstacle_at_base(self) -> int | None:
        """Return the index of an obstacle at the base, with which every configuration collides; None if none is."""
        base, limit = shapely.Point(self.arm.base), self.reach_of_links - CONTACT
        for number, obstacle in enumerate(self.obstacles):
            if obstacle.covers(self.arm.base) or obstacle.is_nearer(base, limit):
                return number
        return None

    @property
    def _and_clearance(self) -> str:
        return f" and the clearance {self.clearance:g}" if self.clearance else ""

    @property
    def reach_of_links(self) -> float:
        """The least distance between an obstacle and the axis of a link, m: the link's radius plus the clearance."""
        return self.arm.radius + self.clearance

    @property
    def apart(self) -> float:
        """The least distance between the axes of two links that are not neighbours, m."""
        return 2.0 * self.arm.radius + self.clearance

    @cached_property
    def joint_ranges(self) -> tuple[Configurations, Configurations]:
        """The lowest angle of each joint, and the width of its range, rad; shape (links,) each."""
        limits = np.array(self.arm.limits or [(0.0, 2.0 * np.pi)] * len(self.arm.links))
        return limits[:, 0], limits[:, 1] - limits[:, 0]

    @property
    def steps(self) -> int:
        """The number of code steps in a joint's range.

        Within limits, 2^q codes span 2^q − 1 steps. On a full circle one more step leads from the last code back to the
        first.
        """
        return (1 << self.bits) - (0 if self.arm.limits is None else 1)
