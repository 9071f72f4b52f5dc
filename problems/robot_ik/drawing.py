"""Pictures of robot-ik: the robot at its solutions among obstacles, and the joints within their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from problems.problem import Populations, Solution
from problems.robot_ik.model import RobotIkModel, pose_of
from problems.robots.pictures import draw_robot, draw_solids, fit, shells_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

COLORS = ("#1f5fa8", "#d9731a", "#2a8c4a", "#8a4fbf", "#c45aa0", "#7a6a4f")
TARGET = "#c8321e"
_AXIS = 0.12  # m, the length of the axes of the pose
_MOST_DRAWN = 6  # solutions
_MOST_LINES = 60  # individuals of a population


def draw(problem: RobotIkModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Fill an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    figure.set_size_inches(12.0, 6.0)
    left, right = np.ravel(figure.subfigures(1, 2, width_ratios=[1.25, 1.0], squeeze=False))
    found = [] if solution is None else [solution["configuration"], *solution.get("others", [])]
    several = np.array(found, float).reshape(-1, len(problem.scene.arm.joints))
    _draw_scene(problem, left.add_subplot(projection="3d"), several, solution)
    _draw_joints(problem, right.subplots(), several, populations)


def _draw_scene(problem: RobotIkModel, axes: Any, several: Floats, solution: Solution | None) -> None:
    arm, shells = problem.scene.arm, shells_of(problem.scene.arm)
    solids, seen = draw_solids(axes, problem.scene), [_draw_pose(problem, axes)]
    shown = several[:_MOST_DRAWN] if len(several) else arm.limits.mean(axis=1)[None]
    for number, configuration in enumerate(shown):
        color = COLORS[number % len(COLORS)] if len(several) else "0.6"
        alpha = 0.6 if number == 0 and len(several) else 0.2
        seen.append(draw_robot(axes, arm, shells, configuration, color, alpha))
    fit(axes, np.concatenate(seen), solids)
    if solution is None:
        axes.set_title("no configuration found")
    else:
        axes.set_title(f"{solution['position_error']:.2g} m, {solution['angle_error']:.2g} rad from the pose")


def _draw_pose(problem: RobotIkModel, axes: Any) -> Floats:
    """Draw the axes of the pose, or a mark if any rotation will do; return its points, m."""
    frame = pose_of(problem.goal_pose).reshape(3, 4)
    place = frame[:, 3]
    axes.plot(*place[:, None], marker="x", markersize=9, markeredgewidth=2.5, color=TARGET, zorder=9)
    ends = place + _AXIS * frame[:, :3].T
    if problem.goal_pose.quaternion is not None:
        for end, color in zip(ends, ("#c8321e", "#2a8c4a", "#1f5fa8"), strict=True):
            axes.plot(*np.array([place, end]).T, color=color, linewidth=2.5, zorder=9)
    points: Floats = np.concatenate([place[None], ends])
    return points


def _draw_joints(problem: RobotIkModel, axes: Any, several: Floats, populations: Populations) -> None:
    """Draw each configuration as a line over the joints, from the lowest to the highest value of each."""
    arm = problem.scene.arm
    count, (low, high) = len(arm.joints), arm.limits.T
    places = np.arange(count)
    for generation, color in ((min(populations), "0.75"), (max(populations), "#8a4fbf")) if populations else ():
        shares = problem.coding.genes(populations[generation][:_MOST_LINES]).reshape(-1, count)
        axes.plot(places, shares.T, color=color, linewidth=0.5)
        axes.plot([], [], color=color, label=f"individuals of generation {generation}")
    for number, configuration in enumerate(several):
        label = "solution" if len(several) == 1 else f"solution {number + 1}"
        shares = (configuration - low) / np.maximum(high - low, 1e-12)
        axes.plot(places, shares, color=COLORS[number % len(COLORS)], marker="o", linewidth=1.8, label=label)
    axes.set_xticks(places, arm.joints, rotation=30, ha="right")
    axes.set(ylim=(-0.02, 1.02), ylabel="share of the joint's range")
    if populations or len(several):
        axes.figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")
