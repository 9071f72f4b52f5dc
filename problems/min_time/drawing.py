"""Pictures of min-time: nodes in joint space (figure 1 of the paper), and joints and torques in time (figure 2)."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from problems.problem import Populations, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from problems.min_time.model import MinTimeModel

Floats = NDArray[np.float64]

CURVE = "#1f5fa8"
START = "#2a8c4a"
GOAL = "#c8321e"
COLORS = ("#1f5fa8", "#d9731a", "#2a8c4a", "#8a4fbf", "#c8321e", "#7a6a4f", "#c45aa0")
_MOST_LINES = 60  # a finer grid is not drawn
_SCHEME = """\
The first trajectories are random: from a node
to one of its neighbours, with these odds,
2^(joints towards the goal − joints away)"""


def draw(problem: MinTimeModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Fill an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    if problem.arm.size == 2:
        figure.set_size_inches(12.0, 7.0)
        left, right = np.ravel(figure.subfigures(1, 2, width_ratios=[1.0, 1.15], squeeze=False))
        space, scheme = left.subplots(2, 1, height_ratios=[5.0, 1.0])
        _draw_space(problem, space, solution, populations)
        _draw_scheme(problem, scheme)
    else:
        figure.set_size_inches(8.0, 7.0)
        right = figure
    above, below = right.subplots(2, 1, sharex=True)
    _draw_motion(problem, above, below, solution)


def _draw_space(problem: MinTimeModel, axes: Axes, solution: Solution | None, populations: Populations) -> None:
    """Draw the grid, the nodes and their curve in joint space."""
    start, goal = np.array(problem.start), np.array(problem.goal)
    _draw_grid(problem, axes)
    if populations:
        _draw_population(problem, axes, populations)
    if solution is not None:
        nodes, q = np.array(solution["nodes"]), np.array(solution["trajectory"]["q"])
        axes.plot(*q.T, color=CURVE, linewidth=2.5, zorder=5, label="curve")
        axes.plot(*nodes.T, "o--", color=CURVE, linewidth=0.8, markersize=7, markerfacecolor="white", zorder=6,
                  label="nodes")  # fmt: skip
    for place, color, label in ((start, START, "start"), (goal, GOAL, "goal")):
        axes.plot(*place, "o", markersize=11, color=color, zorder=7, label=label)
    margin = 0.06 * np.abs(goal - start).max() or 0.1
    low, high = np.minimum(start, goal) - margin, np.maximum(start, goal) + margin
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="joint 1 / rad", ylabel="joint 2 / rad")
    axes.set_title("no trajectory found" if solution is None else f"{len(solution['nodes']) - 2} nodes between")
    axes.figure.legend(loc="outside lower center", ncols=4, frameon=False)


def _draw_grid(problem: MinTimeModel, axes: Axes) -> None:
    if problem.grid > _MOST_LINES:
        return
    shares = np.linspace(0.0, 1.0, problem.grid)[:, None]
    lines = problem.start + shares * np.subtract(problem.goal, problem.start)
    for x in lines[:, 0]:
        axes.plot([x, x], lines[[0, -1], 1], color="0.85", linewidth=0.7, zorder=1)
    for y in lines[:, 1]:
        axes.plot(lines[[0, -1], 0], [y, y], color="0.85", linewidth=0.7, zorder=1)


def _draw_scheme(problem: MinTimeModel, axes: Axes) -> None:
    """Draw the relative transition scheme (figure 1) with its odds: the likelier a move, the darker its arrow."""
    axes.set_axis_off()
    axes.set(aspect="equal", xlim=(-1.7, 9.3), ylim=(-1.5, 1.5))
    towards = np.sign(np.subtract(problem.goal, problem.start))
    moves = [move for move in product((-1, 0, 1), repeat=2) if _is_possible(move, towards)]
    for move in moves:
        odds = 2.0 ** (move.count(1) - move.count(-1))
        tip = towards * move
        axes.annotate("", xy=tuple(tip), xytext=(0.0, 0.0), arrowprops={
            "arrowstyle": "-|>", "color": str(0.75 - 0.18 * odds), "linewidth": 0.7 + 0.45 * odds,
            "shrinkA": 0, "shrinkB": 0,
        })  # fmt: skip
        x, y = 1.3 * tip
        axes.text(x, y, "½" if odds == 0.5 else f"{odds:g}", ha="center", va="center", fontsize="small")
    if moves:
        axes.text(2.2, 0.0, _SCHEME, va="center", fontsize="small")


def _is_possible(move: tuple[int, ...], towards: Floats) -> bool:
    """Return whether some joint moves, at most one away from the goal, and none whose start is its goal."""
    return any(move) and move.count(-1) <= 1 and not np.any((towards == 0.0) & (np.array(move) != 0))


def _draw_population(problem: MinTimeModel, axes: Axes, populations: Populations) -> None:
    """Draw the nodes of the first and of the last generation, joined by lines."""
    for generation, color in ((min(populations), "0.7"), (max(populations), "#8a4fbf")):
        lines = [_nodes(problem, genome) for genome in populations[generation]]
        axes.add_collection(LineCollection(lines, colors=color, linewidths=0.5, alpha=0.5, zorder=2))
        axes.plot([], [], color=color, label=f"generation {generation}")


def _nodes(problem: MinTimeModel, genome: NDArray[np.uint8]) -> Floats:
    genes = problem.coding.items(genome)[:, :-1] / np.maximum(problem.coding.greatest, 1)
    span = np.subtract(problem.goal, problem.start)
    nodes: Floats = np.concatenate([[problem.start], problem.start + genes * span])
    return nodes


def _draw_motion(problem: MinTimeModel, above: Axes, below: Axes, solution: Solution | None) -> None:
    """Draw joint angles over time, and beneath them the torques as shares of their limits."""
    if solution is not None:
        rows = {name: np.array(values) for name, values in solution["trajectory"].items()}
        t, q = _between_rows(rows["t"], rows["q"], rows["qd"])
        shares = rows["torque"] / problem.arm.limit_of("torque")
        for joint, name in enumerate(problem.arm.names):
            color = COLORS[joint % len(COLORS)]
            above.plot(t, q[:, joint], color=color, linewidth=2.0, label=name)
            below.plot(rows["t"], shares[:, joint], color=color, linewidth=1.6)
        above.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize="small")
        above.set_title(f"{solution['time']:.4f} s")
    for side in (-1.0, 1.0):
        below.axhline(side, color=GOAL, linewidth=1.2, linestyle="--")
    below.text(0.995, 1.03, "limit", color=GOAL, ha="right", va="bottom", transform=below.get_yaxis_transform())
    below.axhline(0.0, color="0.8", linewidth=0.8, zorder=0)
    below.set(ylim=(-1.25, 1.25), xlabel="t / s", ylabel="torque / limit")
    above.set_ylabel("joint angle / rad")


def _between_rows(t: Floats, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
    """Return more times and angles, by a cubic Hermite polynomial in each step.

    Rows are equally spaced along the curve, so where the arm is slow they are far apart in time.
    """
    times, angles = [t[:1]], [q[:1]]
    for row in range(len(t) - 1):
        share = np.linspace(0.0, 1.0, 9)[1:, None]
        step, rest = t[row + 1] - t[row], 1.0 - share
        times.append(t[row] + step * share[:, 0])
        angles.append(
            rest**2 * (1 + 2 * share) * q[row]
            + share**2 * (3 - 2 * share) * q[row + 1]
            + step * share * rest * (rest * qd[row] - share * qd[row + 1])
        )
    return np.concatenate(times), np.concatenate(angles)
