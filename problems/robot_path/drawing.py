"""Pictures of robot-path: the robot in its scene with start, goal and swept path, and its joints along the path."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from problems.problem import Populations, Solution
from problems.robots.animating import places_of, tips_of, ways_of
from problems.robots.pictures import Pose, draw_line, draw_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.robot_path.model import RobotPathModel

Floats = NDArray[np.float64]

START, GOAL, SWEPT = "#2a8c4a", "#c8321e", "#1f5fa8"
WAYS = ("#0b2d5c", "#a0188c", "#b35900", "#00706b")
COLORS = ("#1f5fa8", "#d9731a", "#2a8c4a", "#8a4fbf", "#c8321e", "#7a6a4f", "#c45aa0")
STYLES = ("-", "--", ":")  # of joints that share a color
_STILL = 1e-3  # m, a tip that moves less has no way
_BETWEEN = 4  # configurations drawn between start and goal
_LINES = 60  # configurations whose last point is joined to a line
_MOST_PATHS = 24  # of a population


def draw(problem: RobotPathModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Fill an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    figure.set_size_inches(12.0, 6.0)
    left, right = np.ravel(figure.subfigures(1, 2, width_ratios=[1.35, 1.0], squeeze=False))
    _draw_scene(problem, left.add_subplot(projection="3d"), solution)
    _draw_joints(problem, right.subplots(), solution, populations)


# The scene ------------------------------------------------------------------------------------------------------------
def _draw_scene(problem: RobotPathModel, axes: Any, solution: Solution | None) -> None:
    path = np.array([problem.start, problem.ends[0]] if solution is None else solution["path"])
    poses, ways = [], []
    if solution is not None:
        ways = _draw_ways(problem, axes, path)
        poses += [Pose(each, SWEPT, 0.12) for each in _along(path, _BETWEEN + 2)[1:-1]]
        poses[0] = replace(poses[0], name="on the way")
    poses = [Pose(path[0], START, 0.65, "start"), Pose(path[-1], GOAL, 0.65, "goal"), *poses]
    draw_scene(axes, problem, poses, ways)
    axes.set_title(_title(solution))


def _draw_ways(problem: RobotPathModel, axes: Any, path: Floats) -> list[Floats]:
    """Draw the ways of all tips that move, from a mark at the start to one at the goal; return their points, m."""
    arm, link = problem.scene.arm, None if problem.goal_pose is None else problem.goal_pose.link
    ways = ways_of(arm, places_of(arm, _along(path, _LINES)), link)
    moving = [
        (way, name) for way, name in zip(ways, tips_of(arm, link), strict=True) if np.ptp(way, axis=0).max() > _STILL
    ]
    for number, (way, name) in enumerate(moving):
        draw_line(axes, way, WAYS[number % len(WAYS)], label=f"way of {name}")
        for end, color in ((way[0], START), (way[-1], GOAL)):
            axes.plot(*end[:, None], marker="o", markersize=6, color=color, markeredgecolor="white", zorder=4)
    return [way for way, _ in moving]


def _title(solution: Solution | None) -> str:
    if solution is None:
        return "no path found"
    blocked = ", not free" if "blocked" in solution else ""
    return f"{solution['length']:.2f} rad, {len(solution['path']) - 2} points between{blocked}"


def _along(path: Floats, count: int) -> Floats:
    """Return so many configurations, evenly spaced along the path."""
    lengths = _lengths(path)
    return np.column_stack([np.interp(np.linspace(0.0, lengths[-1], count), lengths, column) for column in path.T])


# The joints -----------------------------------------------------------------------------------------------------------
def _draw_joints(problem: RobotPathModel, axes: Any, solution: Solution | None, populations: Populations) -> None:
    """Draw each joint along the path; behind them the paths of the first and last generation."""
    for generation, color in ((min(populations), "0.8"), (max(populations), "0.5")) if populations else ():
        for genome in populations[generation][:_MOST_PATHS]:
            path = np.array(problem.decode(genome)["path"])
            axes.plot(_lengths(path), path, color=color, linewidth=0.4)
        axes.plot([], [], color=color, label=f"generation {generation}")
    if solution is not None:
        path = np.array(solution["path"])
        for joint, name in enumerate(problem.scene.arm.joints):
            color, style = COLORS[joint % len(COLORS)], STYLES[joint // len(COLORS) % len(STYLES)]
            axes.plot(_lengths(path), path[:, joint], color=color, linestyle=style, linewidth=1.8, label=name)
    axes.set(xlabel="along the path / rad", ylabel="joint / rad (m if prismatic)")
    if populations or solution is not None:
        axes.figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")


def _lengths(path: Floats) -> Floats:
    """Return the length of the path up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
