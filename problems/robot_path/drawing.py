"""Pictures of robot-path: the robot in its scene with start, goal and swept path, and its joints along the path."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection
from numpy.typing import NDArray

from problems.problem import Populations, Solution
from problems.robots.pictures import draw_robot, draw_solids, fit, frames_of, shells_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from problems.robot_path.model import RobotPathModel

Floats = NDArray[np.float64]

START, GOAL, SWEPT = "#2a8c4a", "#c8321e", "#1f5fa8"
COLORS = ("#1f5fa8", "#d9731a", "#2a8c4a", "#8a4fbf", "#c8321e", "#7a6a4f", "#c45aa0")
_BETWEEN = 5  # configurations drawn between start and goal
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
    arm, shells = problem.scene.arm, shells_of(problem.scene.arm)
    goal = np.array(problem.ends[0])
    solids, seen = draw_solids(axes, problem.scene), []
    if solution is not None:
        path = np.array(solution["path"])
        goal = path[-1]
        for configuration in _along(path, _BETWEEN + 2)[1:-1]:
            seen.append(draw_robot(axes, arm, shells, configuration, SWEPT, 0.10))
        ends = np.array([frames_of(arm, each)[-1, :, 3] for each in _along(path, _LINES)])
        axes.add_collection3d(Line3DCollection([ends], colors=SWEPT, linewidths=1.6))
    seen.append(draw_robot(axes, arm, shells, np.array(problem.start), START, 0.55))
    seen.append(draw_robot(axes, arm, shells, goal, GOAL, 0.55))
    fit(axes, np.concatenate(seen), solids)
    axes.set_title(_title(solution))


def _title(solution: Solution | None) -> str:
    if solution is None:
        return "no path found"
    blocked = ", not free" if "blocked" in solution else ""
    return f"{solution['length']:.2f} rad, {len(solution['path']) - 2} points between{blocked}"


def _along(path: Floats, count: int) -> Floats:
    """Return so many configurations, evenly spaced along the path."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    return np.column_stack([np.interp(np.linspace(0.0, lengths[-1], count), lengths, column) for column in path.T])


# The joints -----------------------------------------------------------------------------------------------------------
def _draw_joints(problem: RobotPathModel, axes: Any, solution: Solution | None, populations: Populations) -> None:
    """Draw each joint along the path, within its limits; behind them the paths of the first and last generation."""
    arm = problem.scene.arm
    if populations:
        for generation, color in ((min(populations), "0.75"), (max(populations), "#8a4fbf")):
            for genome in populations[generation][:_MOST_PATHS]:
                _draw_lines(axes, np.array(problem.decode(genome)["path"]), [color] * len(arm.joints), 0.4)
            axes.plot([], [], color=color, label=f"generation {generation}")
    if solution is not None:
        _draw_lines(axes, np.array(solution["path"]), COLORS, 1.8)
        for joint, name in enumerate(arm.joints):
            axes.plot([], [], color=COLORS[joint % len(COLORS)], label=name)
    axes.set(xlabel="along the path / rad", ylabel="joint / rad (m if prismatic)")
    if populations or solution is not None:
        axes.figure.legend(loc="outside lower center", ncols=3, frameon=False, fontsize="small")


def _draw_lines(axes: Any, path: Floats, colors: Any, width: float) -> None:
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    for joint, values in enumerate(path.T):
        axes.plot(along, values, color=colors[joint % len(colors)], linewidth=width)
