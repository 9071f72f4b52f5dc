"""Pictures of known functions: a map of the first two parameters, the bits, or a graph sorted by parts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.colors import ListedColormap

from problems.function import formulas
from problems.problem import Populations, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from problems.function.model import FunctionModel

_PIXELS = 301
_BITS_IN_A_ROW = 64
_FOUND = "#c8321e"
_LAST = "#1f5fa8"


def draw(problem: FunctionModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Draw onto an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    axes = figure.subplots()
    if problem.graph is not None:
        _draw_graph(problem, axes, solution)
    elif problem.bounds is None:
        figure.set_size_inches(9, 1 + 0.14 * -(-problem.dimension // _BITS_IN_A_ROW))
        _draw_bits(problem, axes, solution)
    elif problem.dimension == 1:
        _draw_curve(problem, axes, solution)
    else:
        figure.set_size_inches(7, 6.5)
        _draw_map(problem, figure, axes, solution, populations)
    if solution is not None:
        axes.set_title(f"{problem.name}: {solution['value']:.4g}")


def _draw_curve(problem: FunctionModel, axes: Axes, solution: Solution | None) -> None:
    assert problem.bounds is not None, "a curve is of numbers"
    x = np.linspace(*problem.bounds, 2001)
    axes.plot(x, formulas.value(problem.name, x[:, None]), color="0.5")
    if solution is not None:
        axes.plot(solution["x"], [solution["value"]], "+", color=_FOUND, markersize=12, markeredgewidth=2)
    axes.set_xlabel("x₁")
    axes.set_ylabel("value")


def _draw_map(
    problem: FunctionModel, figure: Figure, axes: Axes, solution: Solution | None, populations: Populations
) -> None:
    """Draw the function over its first two parameters; the others are those of the solution, or 0."""
    assert problem.bounds is not None, "a map is of numbers"
    grid = np.linspace(*problem.bounds, _PIXELS)
    points = np.zeros((_PIXELS, _PIXELS, problem.dimension))
    if solution is not None:
        points[:] = solution["x"]
    points[..., 0], points[..., 1] = np.meshgrid(grid, grid)
    shades = axes.contourf(grid, grid, formulas.value(problem.name, points), levels=24, cmap="Greys", alpha=0.8)
    figure.colorbar(shades, ax=axes, label="value", shrink=0.85)
    for generation, marker, color in _first_and_last(populations):
        x = problem.points(populations[generation])
        axes.plot(x[:, 0], x[:, 1], marker, color=color, markersize=5, label=f"generation {generation}")
    if solution is not None:
        axes.plot(*solution["x"][:2], "+", color=_FOUND, markersize=14, markeredgewidth=2, label="found")
    if axes.get_legend_handles_labels()[0]:
        figure.legend(loc="outside lower center", ncols=3, frameon=False)
    axes.set_xlabel("x₁")
    axes.set_ylabel("x₂")
    axes.set_aspect("equal")


def _first_and_last(populations: Populations) -> list[tuple[int, str, str]]:
    if not populations:
        return []
    last = (max(populations), ".", _LAST)
    return [last] if len(populations) == 1 else [(min(populations), "x", "0.2"), last]


def _draw_bits(problem: FunctionModel, axes: Axes, solution: Solution | None) -> None:
    """Draw the bits row by row, ones dark and zeros light."""
    bits = np.full(-(-problem.dimension // _BITS_IN_A_ROW) * _BITS_IN_A_ROW, np.nan)
    if solution is not None:
        bits[: problem.dimension] = [int(bit) for bit in solution["bits"]]
    rows = bits.reshape(-1, _BITS_IN_A_ROW)[:, : problem.dimension]
    axes.pcolormesh(rows, cmap=ListedColormap(["0.9", _LAST]), vmin=0, vmax=1, edgecolors="white", linewidth=0.5)
    axes.invert_yaxis()
    axes.set_aspect("equal")
    axes.set_yticks([])
    axes.set_xlabel("bit")


def _draw_graph(problem: FunctionModel, axes: Axes, solution: Solution | None) -> None:
    """Draw the adjacency matrix with vertices sorted by their part, found or planted; edges between parts are cut."""
    assert problem.graph is not None, "a matrix is of a graph"
    graph = problem.graph
    parts = graph.planted if solution is None else np.array(solution["parts"])
    order = np.argsort(parts, kind="stable")
    place = np.argsort(order)  # the inverse permutation: the place of each vertex in the order
    one, other = place[graph.edges[:, 0]], place[graph.edges[:, 1]]
    axes.plot(
        np.concatenate([one, other]), np.concatenate([other, one]), "s", color=_LAST, markersize=200 / graph.vertices
    )
    for end in np.cumsum(np.bincount(parts, minlength=graph.parts))[:-1]:
        axes.axhline(end - 0.5, color=_FOUND, linewidth=1)
        axes.axvline(end - 0.5, color=_FOUND, linewidth=1)
    axes.set_xlim(-1, graph.vertices)
    axes.set_ylim(graph.vertices, -1)
    axes.set_aspect("equal")
    axes.set_xlabel("vertices, sorted by part")
    axes.set_ylabel("vertices, sorted by part")
