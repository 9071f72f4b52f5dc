"""Pictures of arm-path: the path in workspace and configuration space, and what was evaluated (figures 4 and 5)."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from problems.outlines import capsule
from problems.plane import draw_obstacles
from problems.problem import Solution

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.typing import ColorType

    from problems.arm_path.model import ArmPathModel

Rows = NDArray[np.float64]  # (n, links), rad

ARM = "#1f5fa8"
SWEPT = (0.12, 0.37, 0.66)
_THROUGH = 0.35  # opacity of a link, as a share of its axis's: many links are drawn over each other
START = "#2a8c4a"
GOAL = "#c8321e"
FREE, BLOCKED, UNKNOWN = (1.0, 1.0, 1.0), (0.62, 0.62, 0.62), (0.90, 0.90, 0.88)
EVALUATED = (0.72, 0.85, 0.97)
_STEP = 0.18  # rad, from one drawn arm to the next


def draw(problem: ArmPathModel, figure: Figure, solution: Solution | None) -> None:
    """Draw onto an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    path = None if solution is None else np.array(solution["path"])
    if problem.is_flat:
        figure.set_size_inches(12.0, 6.6)
        world, space = figure.subplots(1, 2)
        handles = _draw_space(problem, space, solution)
        figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    else:
        figure.set_size_inches(12.0, 6.0)
        world, space = figure.subplots(1, 2, width_ratios=[1, 1])
        _draw_angles(problem, space, path)
    _draw_world(problem, world, path)


def _draw_world(problem: ArmPathModel, axes: Axes, path: Rows | None) -> None:
    arm = problem.arm
    draw_obstacles(axes, problem.obstacles)
    if path is not None:
        arms = _joints(problem, _along(path))
        shades = np.linspace(0.15, 0.75, len(arms))
        _draw_links(problem, axes, arms, [(*SWEPT, _THROUGH * shade) for shade in shades])
        axes.add_collection(
            LineCollection(list(arms), colors=[(*SWEPT, shade) for shade in shades], linewidths=0.7, zorder=3)
        )
        axes.plot(*arms[:, -1].T, color=ARM, linewidth=1.4, zorder=4)
    for configuration, color, label in ((problem.start, START, "start"), (problem.goal, GOAL, "goal")):
        joints = _joints(problem, np.array([configuration]))
        _draw_links(problem, axes, joints, [to_rgba(color, 0.45)], zorder=5)
        axes.plot(*joints[0].T, "-o", color=color, linewidth=2.0, markersize=4, zorder=6, label=label)
    axes.plot(*arm.base, marker="s", markersize=9, color="black", zorder=7)
    reach = 1.05 * sum(arm.links)
    axes.set_xlim(arm.base[0] - reach, arm.base[0] + reach)
    axes.set_ylim(arm.base[1] - reach, arm.base[1] + reach)
    axes.set_aspect("equal")
    axes.set_xlabel("x / m")
    axes.set_ylabel("y / m")
    axes.set_title(_title(problem, path))
    axes.legend(loc="upper right", framealpha=0.9, fontsize="small")


def _draw_links(
    problem: ArmPathModel, axes: Axes, arms: NDArray[np.float64], colors: Sequence[ColorType], zorder: float = 2
) -> None:
    """Draw the links of several arms with their true thickness; ``arms`` has the shape (n, links + 1, 2)."""
    if problem.arm.radius == 0.0:
        return
    outlines = [capsule(*ends, problem.arm.radius) for arm in arms for ends in pairwise(arm)]
    axes.add_collection(
        PolyCollection(outlines, facecolors=np.repeat(colors, arms.shape[1] - 1, axis=0), zorder=zorder)
    )


def _title(problem: ArmPathModel, path: Rows | None) -> str:
    """Return the number of moves, the sum of all turns and, if the goal is missed, the distance from it."""
    if path is None:
        return "no path found"
    turned = np.abs(np.diff(path, axis=0)).sum()
    off = np.array(problem.goal) - path[-1]
    off = (off + np.pi) % (2 * np.pi) - np.pi if problem.arm.limits is None else off
    away = float(np.linalg.norm(off))
    short = f", ends {away:.2f} rad from the goal" if away > 1e-6 else ""
    return f"{len(path) - 1} moves, {turned:.1f} rad{short}"


def _joints(problem: ArmPathModel, configurations: Rows) -> NDArray[np.float64]:
    """Return the base, the joints and the tip of each configuration, m, shape (n, links + 1, 2)."""
    headings = np.cumsum(configurations, axis=1)
    steps = np.array(problem.arm.links)[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=-1)
    base = np.broadcast_to(problem.arm.base, (len(steps), 1, 2))
    joints: NDArray[np.float64] = np.cumsum(np.concatenate([base, steps], axis=1), axis=1)
    return joints


def _along(path: Rows) -> Rows:
    """Return the corners of a path, and configurations between them at most `_STEP` apart."""
    rows = [path[:1]]
    for row, following in pairwise(path):
        count = max(1, int(np.ceil(np.abs(following - row).max() / _STEP)))
        rows.append(row + (following - row) * np.linspace(0.0, 1.0, count + 1)[1:, None])
    return np.concatenate(rows)


def _draw_space(problem: ArmPathModel, axes: Axes, solution: Solution | None) -> list[Artist]:
    """Draw what was evaluated and the path, joint 1 to the right and joint 2 upwards; return the legend's handles."""
    lowest, ranges = problem.joint_ranges
    extent = (lowest[0], lowest[0] + ranges[0], lowest[1], lowest[1] + ranges[1])
    axes.imshow(_cells(problem, solution), extent=extent, origin="lower", aspect="auto", interpolation="nearest")
    handles: list[Artist] = [
        Patch(facecolor=BLOCKED, label="collision"),
        Patch(facecolor=UNKNOWN, label="free, never looked at"),
        Patch(facecolor=EVALUATED, label="legal ranges computed"),
    ]
    is_torus = problem.arm.limits is None
    if solution is not None:
        for line in _wrapped(np.array(solution["path"]), lowest, ranges, is_torus):
            axes.plot(*line.T, color=ARM, linewidth=2.2, zorder=4)
        handles.append(Line2D([], [], color=ARM, linewidth=2.2, label="path"))
    for configuration, color, label in ((problem.start, START, "start"), (problem.goal, GOAL, "goal")):
        place = np.array(configuration)
        place = lowest + (place - lowest) % ranges if is_torus else place
        axes.plot(*place, "o", color=color, markeredgecolor="white", markersize=11, zorder=6)
        handles.append(Line2D([], [], marker="o", linestyle="", color=color, markersize=9, label=label))
    axes.set_xlim(*extent[:2])
    axes.set_ylim(*extent[2:])
    axes.set_box_aspect(1)
    axes.set_xlabel("joint 1 / rad")
    axes.set_ylabel("joint 2 / rad")
    share = "" if solution is None else f", {100 * solution['cspace_evaluated']:.1f} % evaluated"
    axes.set_title("configuration space" + share)
    return handles


def _cells(problem: ArmPathModel, solution: Solution | None) -> NDArray[np.float64]:
    """Return the colour of each cell as an image, (levels, levels, 3), whose rows are the codes of joint 2."""
    levels = problem.levels
    # The slices of joint 1 at all codes of joint 2 are the whole of free space.
    all_of_joint_1 = np.zeros((2, levels + 2), np.uint8)
    all_of_joint_1[0, :levels] = 1
    picture = np.where(problem.cells_in(all_of_joint_1)[..., None], UNKNOWN, BLOCKED)
    if solution is not None:
        ends = {"start": levels, "goal": levels + 1}
        computed = np.zeros_like(all_of_joint_1)
        for joint, places in enumerate(solution["slices"]):
            computed[joint, [ends.get(place, place) for place in places]] = 1
        picture[problem.cells_in(computed)] = EVALUATED
    return picture.transpose(1, 0, 2)


def _wrapped(path: Rows, lowest: Rows, ranges: Rows, is_torus: bool) -> list[Rows]:
    """Return the path as lines: on the torus, one copy for each full turn, shifted so that the picture shows a part."""
    if not is_torus:
        return [path]
    least = np.floor((path.min(axis=0) - lowest) / ranges).astype(int)
    most = np.floor((path.max(axis=0) - lowest) / ranges).astype(int)
    return [path - ranges * [one, two] for one in range(least[0], most[0] + 1) for two in range(least[1], most[1] + 1)]


def _draw_angles(problem: ArmPathModel, axes: Axes, path: Rows | None) -> None:
    """Draw each joint's angle after each move, for arms of more than two links."""
    if path is not None:
        for joint in range(path.shape[1]):
            axes.plot(path[:, joint], "-o", markersize=3.5, label=f"joint {joint + 1}")
    axes.set_xlabel("move")
    axes.set_ylabel("angle / rad")
    axes.set_title("joint angles, one moving at a time")
    if path is not None:
        axes.legend(fontsize="small")
