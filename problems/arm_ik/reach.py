"""Bounds of the distance between an arm's base and its tip, in closed form. Collisions are not considered."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.errors import shorten

if TYPE_CHECKING:
    from problems.arm_ik.model import ArmIkModel
from problems.planar_arm.model import Arm

Range = tuple[float, float]


def reach_of(arm: Arm) -> Range:
    """Return a lower and an upper bound of the tip's distance from the base, m.

    Only the limits of the last joint are used; those of the first joint cannot change the distance. The bounds are
    exact for arms of two links, and for longer arms without limits: these reach every distance between them.
    """
    nearest = farthest = arm.links[-1]  # the tip's distance from the joint reached so far, from the tip inwards
    bends = (-1.0, 1.0) if arm.limits is None else _cosines(*arm.limits[-1])
    for length in arm.links[-2::-1]:
        least, most = bends
        closest = min(max(-length * least, nearest), farthest)
        nearest, farthest = (
            _third_side(length, closest, least),
            max(_third_side(length, nearest, most), _third_side(length, farthest, most)),
        )
        bends = (-1.0, 1.0)
    return nearest, farthest


def missed_by(problem: ArmIkModel) -> float:
    """Return a lower bound of the distance between tip and target, m, and so of the fitness; 0 within reach."""
    nearest, farthest = reach_of(problem.arm)
    away = _distance_to_target(problem)
    return max(0.0, away - farthest, nearest - away)


def complaint(problem: ArmIkModel) -> str | None:
    """Return why the tip cannot come as near to the target as `solved_at`; None if it may, or `solved_at` is None."""
    missed, asked = missed_by(problem), problem.solved_at
    if asked is None or missed <= asked:
        return None
    (nearest, farthest), away, links = reach_of(problem.arm), _distance_to_target(problem), problem.arm.links
    reached = f"at most {farthest:.6g}" if away > farthest else f"at least {nearest:.6g}"
    accepting = np.ceil((missed + asked) * 1e3) / 1e3  # some coded configuration is within `asked` of the nearest pose
    return (
        f"target: expected a point {reached} m from arm.base {list(problem.arm.base)}, the reach of links "
        f"{shorten(links)}, found {list(problem.target)}, {away:.6g} m from it; to get the nearest pose instead, set "
        f"the run's target to {accepting:g} (--target)"
    )


def _distance_to_target(problem: ArmIkModel) -> float:
    """Return the distance of the target from the arm's base, m."""
    return float(np.hypot(*np.subtract(problem.target, problem.arm.base)))


def _third_side(one: float, other: float, cosine: float) -> float:
    """Return the distance between the ends of two joined links; ``cosine`` is that of the angle between directions."""
    return float(np.sqrt(max(0.0, one * one + other * other + 2.0 * one * other * cosine)))


def _cosines(lowest: float, highest: float) -> Range:
    """Return the least and the greatest cosine of the angles in a range, rad."""
    ends = np.cos([lowest, highest])
    # The range contains a multiple of 2π (cosine 1), or an odd multiple of π (cosine −1).
    straight = np.floor(highest / (2.0 * np.pi)) * 2.0 * np.pi >= lowest
    folded = (np.floor(highest / (2.0 * np.pi) - 0.5) + 0.5) * 2.0 * np.pi >= lowest
    return -1.0 if folded else float(ends.min()), 1.0 if straight else float(ends.max())
