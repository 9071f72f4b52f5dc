"""Pictures of arm-ik: the arm among obstacles, and the configuration space of two links (figures 1 to 3)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from numpy.typing import NDArray

from problems.outlines import capsule
from problems.plane import draw_obstacles
from problems.problem import Populations, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from problems.arm_ik.model import ArmIkModel

ARM = "#1f5fa8"
TARGET = "#c8321e"
FIRST = "0.3"
_PIXELS = 361  # of the configuration space, along each axis


def draw(problem: ArmIkModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Draw onto an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    if len(problem.arm.links) == 2:
        figure.set_size_inches(11.5, 6.4)
        world, space = figure.subplots(1, 2)
        handles = _draw_space(problem, space, solution, populations)
        figure.legend(handles=handles, loc="outside lower right", ncols=4, frameon=False)
    else:
        figure.set_size_inches(6.5, 6.5)
        world = figure.subplots()
    _draw_world(problem, world, solution)


def _draw_world(problem: ArmIkModel, axes: Axes, solution: Solution | None) -> None:
    arm = problem.arm
    reach = sum(arm.links)
    draw_obstacles(axes, problem.obstacles)
    axes.add_patch(Circle(arm.base, reach, fill=False, edgecolor="0.8", linestyle=":", zorder=1))
    if solution is not None:
        _draw_arm(problem, axes, solution)
    axes.plot(*arm.base, marker="s", markersize=9, color="black", zorder=6)
    axes.plot(*problem.target, marker="x", markersize=10, markeredgewidth=2.5, color=TARGET, zorder=7)
    margin = 1.06 * max(reach, abs(problem.target[0] - arm.base[0]), abs(problem.target[1] - arm.base[1]))
    axes.set_xlim(arm.base[0] - margin, arm.base[0] + margin)
    axes.set_ylim(arm.base[1] - margin, arm.base[1] + margin)
    axes.set_aspect("equal")
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    if solution is None:
        axes.set_title("no configuration found")
    else:
        axes.set_title(f"tip {solution['distance']:.4f} m from the target")


def _draw_arm(problem: ArmIkModel, axes: Axes, solution: Solution) -> None:
    """Draw the links with their true thickness, their axes as lines that are always visible, and the joints."""
    points = _joints(problem, np.array(solution["configuration"]))
    for start, end in pairwise(points):
        outline = capsule(start, end, problem.arm.radius)
        axes.fill(*outline.T, facecolor=ARM, alpha=0.35, edgecolor=ARM, linewidth=0.8, zorder=3)
    axes.plot(*points.T, color=ARM, linewidth=2, zorder=4)
    axes.plot(*points[:-1].T, "o", markersize=6, color="white", markeredgecolor=ARM, markeredgewidth=1.5, zorder=5)
    axes.plot(*points[-1], "o", markersize=4, color=ARM, zorder=5)


def _unit(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _joints(problem: ArmIkModel, configuration: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the base, the joints and the tip, m, shape (links + 1, 2)."""
    steps = np.array(problem.arm.links)[:, None] * _unit(np.cumsum(configuration))
    joints: NDArray[np.float64] = np.cumsum(np.concatenate([[problem.arm.base], steps]), axis=0)
    return joints


def _draw_space(problem: ArmIkModel, axes: Axes, solution: Solution | None, populations: Populations) -> list[Line2D]:
    """Draw configuration space, joint 1 to the right and joint 2 upwards, and return the legend's handles.

    Collisions are shaded; exact solutions, individuals and the solution found are marked.
    """
    lowest, ranges = problem.joint_ranges
    _draw_collisions(problem, axes)
    handles = [_mark(axes, _exact_solutions(problem), "exact solution", "o", TARGET, 12, hollow=True)]
    if populations:
        first, last = min(populations), max(populations)
        if first != last:
            individuals = problem.angles(populations[first])
            handles.append(_mark(axes, individuals, f"generation {first}", "x", FIRST, 4))
        individuals = problem.angles(populations[last])
        handles.append(_mark(axes, individuals, f"generation {last}", ".", ARM, 7))
    if solution is not None:
        found = np.array([solution["configuration"]])
        handles.append(_mark(axes, found, "found", "+", "black", 11))
    axes.set_xlim(lowest[0], lowest[0] + ranges[0])
    axes.set_ylim(lowest[1], lowest[1] + ranges[1])
    axes.set_box_aspect(1)
    axes.set_xlabel("joint 1 / rad")
    axes.set_ylabel("joint 2 / rad")
    axes.set_title("configuration space, collisions shaded")
    return handles


def _draw_collisions(problem: ArmIkModel, axes: Axes) -> None:
    lowest, ranges = problem.joint_ranges
    shares = (np.arange(_PIXELS) + 0.5) / _PIXELS
    one, two = np.meshgrid(lowest[0] + ranges[0] * shares, lowest[1] + ranges[1] * shares)
    fitness = problem.distances(np.column_stack([one.ravel(), two.ravel()])).reshape(one.shape)
    extent = (lowest[0], lowest[0] + ranges[0], lowest[1], lowest[1] + ranges[1])
    axes.imshow(np.isinf(fitness), extent=extent, origin="lower", aspect="auto", cmap=ListedColormap(["white", "0.78"]))


def _mark(
    axes: Axes,
    configurations: NDArray[np.float64],
    label: str,
    marker: str,
    color: str,
    size: float,
    hollow: bool = False,
) -> Line2D:
    fill = "none" if hollow else color
    (line,) = axes.plot(
        configurations[:, 0],
        configurations[:, 1],
        marker,
        color=color,
        markersize=size,
        markerfacecolor=fill,
        markeredgewidth=1.5,
        label=label,
    )
    return line


def _exact_solutions(problem: ArmIkModel) -> NDArray[np.float64]:
    """Return the free ones of the two configurations that reach the target exactly, rad, shape (0 to 2, 2)."""
    one, two = problem.arm.links
    away = np.array(problem.target) - problem.arm.base
    cosine = (away @ away - one * one - two * two) / (2 * one * two)
    if abs(cosine) > 1:
        return np.empty((0, 2))
    # By the law of cosines, with the elbow bent to either side.
    elbows = np.array([1, -1]) * np.arccos(cosine)
    first = np.arctan2(away[1], away[0]) - np.arctan2(two * np.sin(elbows), one + two * np.cos(elbows))
    lowest, ranges = problem.joint_ranges
    angles: NDArray[np.float64] = lowest + (np.column_stack([first, elbows]) - lowest) % (2 * np.pi)
    usable = np.all(angles <= lowest + ranges, axis=1) & np.isfinite(problem.distances(angles))
    free: NDArray[np.float64] = angles[usable]
    return free
