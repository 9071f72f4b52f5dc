"""Pictures of mobile-robot: the floor, and the robot along its path (figure 6 of the paper)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import Circle, Patch, Polygon, Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from problems.plane import draw_obstacles
from problems.problem import Populations, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from problems.mobile_robot.model import MobileRobotModel

Poses = NDArray[np.float64]  # (n, 3): m, m, rad

ROBOT = "#1f5fa8"
START = "#2a8c4a"
GOAL = "#c8321e"
WALL = "0.2"
_WIDTH = 10.0  # inches, of the figure
_OUTLINES = 0.5  # the distance from one outline to the next, in sizes of the robot


def draw(problem: MobileRobotModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Fill an empty figure; see `problems.problem.Problem.draw`."""
    x0, y0, x1, y1 = problem.bounds
    figure.set_layout_engine("constrained")
    figure.set_size_inches(_WIDTH, float(np.clip(_WIDTH * (y1 - y0) / (x1 - x0), 3.0, 16.0)) + 0.9)
    axes = figure.subplots()
    _draw_floor(problem, axes)
    draw_obstacles(axes, problem.obstacles)
    if populations:
        _draw_population(problem, axes, populations)
        figure.legend(loc="outside lower center", ncols=2, frameon=False)
    if solution is not None:
        _draw_path(problem, axes, np.array(solution["path"]))
    _draw_robot(problem, axes, problem.start, START, "start")
    _draw_robot(problem, axes, problem.goal, GOAL, "goal")
    axes.set_title(_title(problem, solution))
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")


def _title(problem: MobileRobotModel, solution: Solution | None) -> str:
    if solution is None:
        return "no path found"
    away = np.hypot(*np.subtract(solution["path"][-1][:2], problem.goal[:2]))
    short = f", ends {away:.2f} m from the goal" if away > 1e-6 else ""
    return f"{len(solution['commands'])} commands, {solution['length']:.1f} m{short}"


def _draw_floor(problem: MobileRobotModel, axes: Axes) -> None:
    x0, y0, x1, y1 = problem.bounds
    axes.add_patch(
        Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor="#fbfaf6", edgecolor=WALL, linewidth=3.0, zorder=0.5)
    )
    margin = 0.015 * max(x1 - x0, y1 - y0)
    axes.set_xlim(x0 - margin, x1 + margin)
    axes.set_ylim(y0 - margin, y1 + margin)
    axes.set_aspect("equal")


def _body(problem: MobileRobotModel, pose: Poses) -> Patch:
    """Return the robot's outline at a pose."""
    if problem.robot.vertices is None:
        return Circle((pose[0], pose[1]), problem.robot.radius or 0.0)
    cosine, sine = np.cos(pose[2]), np.sin(pose[2])
    return Polygon(np.array(problem.robot.vertices) @ [[cosine, sine], [-sine, cosine]] + pose[:2], closed=True)


def _size(problem: MobileRobotModel) -> float:
    return problem.robot.radius or problem.robot.circumscribed_radius


def _draw_path(problem: MobileRobotModel, axes: Axes, path: Poses) -> None:
    """Draw the swept robot, the line of its reference point, and its heading at each pose in between."""
    bodies = [_body(problem, pose) for pose in _along(path, _OUTLINES * _size(problem))]
    axes.add_collection(PatchCollection(bodies, facecolor=ROBOT, alpha=0.10, edgecolor="none", zorder=3))
    axes.add_collection(
        PatchCollection(bodies, facecolor="none", edgecolor=ROBOT, alpha=0.45, linewidth=0.6, zorder=3.1)
    )
    axes.plot(path[:, 0], path[:, 1], color=ROBOT, linewidth=1.8, zorder=4)
    axes.plot(path[1:-1, 0], path[1:-1, 1], "o", color="white", markeredgecolor=ROBOT, markersize=4, zorder=5)
    ticks = [[pose[:2], pose[:2] + _ahead(pose, 0.9 * _size(problem))] for pose in path[1:-1]]
    axes.add_collection(LineCollection(ticks, colors=ROBOT, linewidths=1.8, zorder=4.5))


def _ahead(pose: Poses, length: float) -> Poses:
    return length * np.array([np.cos(pose[2]), np.sin(pose[2])])


def _along(path: Poses, step: float) -> Poses:
    """Return poses along the path, so many that no point of the robot goes much farther than ``step`` between two."""
    poses = [path[:1]]
    for pose, following in pairwise(path):
        motion = following - pose
        count = int(np.ceil(max(np.hypot(motion[0], motion[1]), step * abs(motion[2])) / step))
        poses.append(pose + motion * np.linspace(0.0, 1.0, count + 1)[1:, None])
    return np.concatenate(poses)


def _draw_robot(
    problem: MobileRobotModel, axes: Axes, pose: tuple[float, float, float], color: str, label: str
) -> None:
    place = np.array(pose)
    patch = _body(problem, place)
    patch.set(facecolor=color, alpha=0.85, edgecolor="white", linewidth=1.0, zorder=6)
    axes.add_patch(patch)
    x, y = pose[:2]
    dx, dy = _ahead(place, 0.75 * _size(problem))
    axes.annotate(
        "",
        xy=(x + dx, y + dy),
        xytext=(x - 0.5 * dx, y - 0.5 * dy),
        arrowprops={"arrowstyle": "-|>", "color": "white", "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0},
        zorder=7,
    )
    below = y - 1.2 * _size(problem)
    name = axes.text(x, below, label, ha="center", va="top", color=color, weight="bold", zorder=8)
    name.set_path_effects([withStroke(linewidth=3.0, foreground="white")])


def _draw_population(problem: MobileRobotModel, axes: Axes, populations: Populations) -> None:
    """Draw where the paths of the first and the last generation end."""
    for generation, marker, color in ((min(populations), "x", "0.45"), (max(populations), "+", "#8a4fbf")):
        ends = np.array([problem.decode(genome)["path"][-1] for genome in populations[generation]])
        axes.plot(
            *ends[:, :2].T, marker, color=color, markersize=6, zorder=5.5, label=f"ends in generation {generation}"
        )
