"""Pictures of coordination: the diagram with its rectangles (figure 3 of the paper), and the arms (figure 4)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.patches import Rectangle
from matplotlib.ticker import MultipleLocator

from problems.coordination.arms import Robot, origins, places
from problems.problem import Populations, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from mpl_toolkits.mplot3d import Axes3D

    from problems.coordination.model import CoordinationModel

Cell = tuple[int, int]

OBSTACLE = "#b9b4aa"
WAY = "#1f5fa8"
START = "#2a8c4a"
END = "#c8321e"
ARMS = ("#1f5fa8", "#d07a1c")
_SIDE = 7.0  # inches
_ARMS_WIDTH = 4.4  # inches
_TICK = 0.5  # m, between the labels of the axes, which share a scale; closer ones would overlap on the vertical axis
_MOST_TICKS = 8  # on each axis


def draw(problem: CoordinationModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Draw onto an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    if problem.robots is None:
        figure.set_size_inches(_SIDE, _SIDE + 0.3)
        _draw_diagram(problem, figure.subplots(), solution, populations)
        return
    figure.set_size_inches(_SIDE + _ARMS_WIDTH, _SIDE + 0.3)
    left, right = figure.subfigures(1, 2, width_ratios=[_SIDE, _ARMS_WIDTH], squeeze=False)[0]
    _draw_diagram(problem, left.subplots(), solution, populations)
    stages = _stages(problem, solution)
    for place, (title, cell) in enumerate(stages, start=1):
        _draw_arms(problem.robots, right.add_subplot(len(stages), 1, place, projection="3d"), cell, title)
    right.legend(*right.axes[0].get_legend_handles_labels(), loc="upper right", fontsize=8, frameon=False)


def _draw_diagram(problem: CoordinationModel, axes: Axes, solution: Solution | None, populations: Populations) -> None:
    i, j = problem.last
    axes.imshow(
        problem.blocked.T,
        cmap=ListedColormap(["#fdfdfb", OBSTACLE]),
        vmin=0,
        vmax=1,
        origin="lower",
        interpolation="nearest",
        aspect="equal" if 0.5 <= (i + 1) / (j + 1) <= 2.0 else "auto",
    )
    if populations:
        _draw_population(problem, axes, populations)
    if solution is not None:
        _draw_sequence(axes, [(0, 0), *map(tuple, solution["points"]), problem.last])
    for cell, name, color in (((0, 0), "start", START), (problem.last, "end", END)):
        axes.plot(*cell, "s", color=color, markersize=8, clip_on=False, zorder=6, label=name)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.09), ncols=4, frameon=False, fontsize="small")
    axes.set_title(_title(solution), pad=14.0)
    axes.set_xlabel("robot 1 / cell")
    axes.set_ylabel("robot 2 / cell")


def _title(solution: Solution | None) -> str:
    if solution is None:
        return "no sequence found"
    return f"{solution['time']:.2f} s, {len(solution['points'])} synchronisation points"


def _draw_sequence(axes: Axes, corners: list[Cell]) -> None:
    """Draw the rectangles, which include the cells at both corners, and the numbered synchronisation points."""
    for (i, j), (k, to) in pairwise(corners):
        axes.add_patch(Rectangle((i - 0.5, j - 0.5), k - i + 1, to - j + 1, facecolor=WAY, alpha=0.16, zorder=2))
        axes.add_patch(
            Rectangle((i - 0.5, j - 0.5), k - i + 1, to - j + 1, fill=False, edgecolor=WAY, linewidth=1.2, zorder=3)
        )
    for number, (i, j) in enumerate(corners[1:-1], start=1):
        axes.plot(i, j, "o", color=WAY, markeredgecolor="white", markersize=6, zorder=5)
        axes.annotate(
            str(number), (i, j), (-5, 5), textcoords="offset points", ha="right", fontsize=9, color=WAY, zorder=7
        )


def _draw_population(problem: CoordinationModel, axes: Axes, populations: Populations) -> None:
    """Mark the synchronisation points of all individuals of the first and of the last generation."""
    for generation, marker, color in ((min(populations), "x", "0.55"), (max(populations), "+", "#8a4fbf")):
        points = [point for genome in populations[generation] for point in problem.decode(genome)["points"]]
        columns = np.array(points).reshape(-1, 2).T
        axes.plot(*columns, marker, color=color, markersize=4, zorder=1.5, label=f"generation {generation}")


def _stages(problem: CoordinationModel, solution: Solution | None) -> list[tuple[str, Cell]]:
    """Return where to show the arms: at the start, at the SP where their tips are nearest, and at the end."""
    start, end = ("start", (0, 0)), ("end", problem.last)
    if solution is None or not solution["points"]:
        return [start, end]
    assert problem.robots is not None, "only arms are shown"
    points = np.array(solution["points"])
    tips = [
        origins(robot, places(robot, indices))[:, -1] for robot, indices in zip(problem.robots, points.T, strict=True)
    ]
    nearest = int(np.argmin(np.linalg.norm(tips[0] - tips[1], axis=1)))
    return [start, (f"synchronisation point {nearest + 1}", tuple(points[nearest])), end]


def _draw_arms(robots: list[Robot], axes: Axes3D, cell: Cell, title: str) -> None:
    for robot, index, color, name in zip(robots, cell, ARMS, ("robot 1", "robot 2"), strict=True):
        tips = origins(robot, places(robot, np.arange(robot.cells)))[:, -1]
        axes.plot(*tips.T, color=color, linewidth=0.8, alpha=0.6)
        joints = origins(robot, places(robot, np.array([index])))[0]
        axes.plot(*joints.T, color=color, linewidth=5.0, solid_capstyle="round", label=name)
        axes.plot(*joints.T, "o", color="white", markersize=2.5)
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal")
    axes.view_init(elev=35.0, azim=-70.0)
    axes.tick_params(labelsize=6, pad=-3)
    for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
        low, high = axis.get_view_interval()
        axis.set_major_locator(MultipleLocator(_TICK * max(1.0, np.ceil((high - low) / (_MOST_TICKS * _TICK)))))
