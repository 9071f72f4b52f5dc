"""How far from its base the tip of an arm can be, in closed form; obstacles and the links themselves are left out."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from problems.errors import shorten

if TYPE_CHECKING:
    from problems.arm_ik.problem import Arm, ArmIk

Range = tuple[float, float]


def reach_of(arm: Arm) -> Range:
    """Return bounds of the tip's distance from the base, m: it is never less than the first, or more than the second.

    Limits count for the last joint alone, and those of the first joint cannot change a distance. An arm of two links
    reaches all distances between the two; one of more links without limits too.
    """
    nearest = farthest = arm.links[-1]  # of the tip from the joint that is the centre so far
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


def missed_by(problem: ArmIk) -> float:
    """Return how far the target surely stays from the tip, m: a lower bound of the fitness; 0 within reach."""
    nearest, farthest = reach_of(problem.arm)
    away = _away(problem)
    return max(0.0, away - farthest, nearest - away)


def complaint(problem: ArmIk) -> str | None:
    """Return why the tip cannot come as near to the target as `solved_at` asks; None if it may, or there is no such."""
    missed, asked = missed_by(problem), problem.solved_at
    if asked is None or missed <= asked:
        return None
    (nearest, farthest), away, links = reach_of(problem.arm), _away(problem), problem.arm.links
    reached = f"at most {farthest:.6g}" if away > farthest else f"at least {nearest:.6g}"
    accepting = np.ceil((missed + asked) * 1e3) / 1e3  # a coded configuration is that near to the nearest of all
    return (
        f"target: expected a point {reached} m from arm.base {list(problem.arm.base)}, the reach of links "
        f"{shorten(links)}, found {list(problem.target)}, {away:.6g} m from it; for the nearest pose all the same, set "
        f"the run's target to {accepting:g} (--target)"
    )


def _away(problem: ArmIk) -> float:
    return float(np.hypot(*np.subtract(problem.target, problem.arm.base)))


def _third_side(one: float, other: float, cosine: float) -> float:
    """Return the distance that two lengths bridge, the second turned from the first by an angle of that cosine."""
    return float(np.sqrt(max(0.0, one * one + other * other + 2.0 * one * other * cosine)))


def _cosines(lowest: float, highest: float) -> Range:
    """Return the least and the greatest cosine of the angles in a range, rad."""
    ends = np.cos([lowest, highest])
    straight = np.floor(highest / (2.0 * np.pi)) * 2.0 * np.pi >= lowest
    folded = (np.floor(highest / (2.0 * np.pi) - 0.5) + 0.5) * 2.0 * np.pi >= lowest
    return -1.0 if folded else float(ends.min()), 1.0 if straight else float(ends.max())
