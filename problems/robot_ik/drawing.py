"""Pictures of robot-ik: the robot at its solutions among obstacles, and the joints within their limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from problems.problem import Populations, Solution
from problems.robot_ik.model import RobotIkModel, pose_of
from problems.robots.pictures import Pose, draw_line, draw_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

COLORS = ("#1f5fa8", "#2a8c4a", "#c8321e", "#58b4e0", "#8fc31f", "#3a3a3a")  # no color of an obstacle
TARGET = "#111111"
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
    arm = problem.scene.arm
    poses = [
        Pose(each, COLORS[number % len(COLORS)], 0.75 if number == 0 else 0.3, f"solution {number + 1}")
        for number, each in enumerate(several[:_MOST_DRAWN])
    ] or [Pose(arm.limits.mean(axis=1), "0.6", 0.3, "middle of all joints")]
    draw_scene(axes, problem, poses, [_draw_pose(problem, axes)])
    if solution is None:
        axes.set_title("no configuration found")
    else:
        axes.set_title(f"{solution['position_error']:.2g} m, {solution['angle_error']:.2g} rad from the pose")


def _draw_pose(problem: RobotIkModel, axes: Any) -> Floats:
    """Draw the axes of the pose, or a mark if any rotation will do; return its points, m."""
    frame = pose_of(problem.goal_pose).reshape(3, 4)
    place = frame[:, 3]
    label = f"pose for {problem.goal_pose.link}"
    axes.plot(
        *place[:, None],
        marker="x",
        markersize=9,
        markeredgewidth=2.5,
        color=TARGET,
        linestyle="",
        label=label,
        zorder=4,
    )
    ends = place + _AXIS * frame[:, :3].T
    if problem.goal_pose.quaternion is not None:
        for end, color in zip(ends, ("#c8321e", "#2a8c4a", "#1f5fa8"), strict=True):
            draw_line(axes, np.array([place, end]), color)
    points: Floats = np.concatenate([place[None], ends])
    return points


def _draw_joints(problem: RobotIkModel, axes: Any, several: Floats, populations: Populations) -> None:
    """Draw each configuration as a line over the joints, from the lowest to the highest value of each."""
    arm = problem.scene.arm
    count, (low, high) = len(arm.joints), arm.limits.T
    places = np.arange(count)
    for generation, color in ((min(populations), "0.8"), (max(populations), "0.5")) if populations else ():
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
