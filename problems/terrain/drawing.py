"""Pictures of terrain: the map and the path (figures 7 to 10 of the paper), and the difficulties (figure 5)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from problems.problem import Populations, Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from problems.terrain.model import TerrainModel

PATH = "#1f5fa8"
START = "#2a8c4a"
GOAL = "#c8321e"
OBSTACLE = "black"
TOO_NEAR = "0.55"
_MAP = 7.0  # inches, the width of the map
_FINEST_GRID = 32  # cells across; on larger maps lines between cells would hide the cells

Color = tuple[float, float, float]


def draw(problem: TerrainModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Fill an empty figure; see `problems.problem.Problem.draw`."""
    rows, columns = len(problem.map), len(problem.map[0])
    figure.set_layout_engine("constrained")
    figure.set_size_inches(_MAP + 4.2, float(np.clip(_MAP * rows / columns, 3.5, 14.0)) + 0.6)
    world, membership = figure.subplots(1, 2, width_ratios=[_MAP, 3.8])
    colors = _colors(problem)
    _draw_map(problem, world, colors)
    _draw_populations(problem, world, populations)
    if solution is not None:
        _draw_path(world, np.array(solution["path"]))
    for name, (row, column), color in (("S", problem.start, START), ("D", problem.goal, GOAL)):
        text = world.text(column, row, name, ha="center", va="center", color=color, weight="bold", size=15, zorder=6)
        text.set_path_effects([withStroke(linewidth=3.0, foreground="white")])
    world.set_title(_title(problem, solution))
    _draw_membership(problem, membership, colors)


def _title(problem: TerrainModel, solution: Solution | None) -> str:
    if solution is None:
        return "no path found"
    title = f"cost {solution['cost']:.4g}, {len(solution['moves'])} moves"
    objections = problem.check(solution).objections
    return f"{title}: {objections[0]}" if objections else title


def _colors(problem: TerrainModel) -> dict[str, Color]:
    """Return the colour of each difficulty on the map: the easiest is white, the harder the darker."""
    present = set("".join(problem.map))
    names = {name for character, name in problem.legend.items() if character in present}
    by_degree = sorted(names, key=lambda name: (_degree(problem, name), name))
    shades = colormaps["YlOrBr"](np.linspace(0.22, 0.68, max(1, len(by_degree) - 1)))
    return {name: to_rgb("white") if place == 0 else to_rgb(shades[place - 1]) for place, name in enumerate(by_degree)}


def _degree(problem: TerrainModel, name: str) -> float:
    return float(np.mean([np.mean(triangle) for triangle in _triangles(problem, name).values()]))


def _triangles(problem: TerrainModel, name: str) -> dict[str, tuple[float, float, float]]:
    difficulty = problem.difficulties[name]
    if isinstance(difficulty, tuple):
        return {name: difficulty}
    return {f"{name}, {way}": getattr(difficulty, way) for way in ("up", "across", "down")}


def _draw_map(problem: TerrainModel, axes: Axes, colors: dict[str, Color]) -> None:
    """Draw obstacles black, cells too near to one grey, and all others shaded by difficulty."""
    blocked = problem.impassable
    rows, columns = blocked.shape
    picture = np.empty((rows, columns, 3))
    for row, characters in enumerate(problem.map):
        for column, character in enumerate(characters):
            name = problem.legend.get(character)
            solid = OBSTACLE if name is None else TOO_NEAR
            picture[row, column] = to_rgb(solid) if blocked[row, column] else colors[str(name)]
    axes.imshow(picture, interpolation="nearest")
    if max(rows, columns) <= _FINEST_GRID:
        axes.set_xticks(np.arange(columns + 1) - 0.5, minor=True)
        axes.set_yticks(np.arange(rows + 1) - 0.5, minor=True)
        axes.grid(which="minor", color="0.8", linewidth=0.6)
        axes.tick_params(which="minor", length=0)
    axes.set_xlabel("column")
    axes.set_ylabel("row")


def _draw_path(axes: Axes, path: NDArray[np.int64]) -> None:
    axes.plot(path[:, 1], path[:, 0], color="white", linewidth=5.0, zorder=4, solid_joinstyle="round")
    axes.plot(path[:, 1], path[:, 0], color=PATH, linewidth=2.6, zorder=5, solid_joinstyle="round")


def _draw_populations(problem: TerrainModel, axes: Axes, populations: Populations) -> None:
    """Draw the paths of the first and of the last generation."""
    if not populations:
        return
    x_limits, y_limits = axes.get_xlim(), axes.get_ylim()
    for generation, color in ((min(populations), "0.5"), (max(populations), "#8a4fbf")):
        for number, genome in enumerate(populations[generation]):
            path = np.array(problem.decode(genome)["path"])
            label = f"generation {generation}" if number == 0 else None
            axes.plot(path[:, 1], path[:, 0], color=color, linewidth=0.9, alpha=0.5, zorder=3, label=label)
    axes.set_xlim(x_limits)
    axes.set_ylim(y_limits)
    axes.legend(loc="upper left", bbox_to_anchor=(0.0, -0.08), ncols=2, frameon=False, fontsize="small")


def _draw_membership(problem: TerrainModel, axes: Axes, colors: dict[str, Color]) -> None:
    """Draw the difficulties as fuzzy numbers: the membership of each degree."""
    greatest, handles = 1.0, []
    for name, color in colors.items():
        for (label, (a, b, c)), style in zip(_triangles(problem, name).items(), ("-", "--", ":"), strict=False):
            greatest = max(greatest, c)
            axes.fill([a, b, c], [0.0, 1.0, 0.0], facecolor=color, alpha=0.5)
            edge: dict[str, Any] = {"edgecolor": "black", "linestyle": style, "linewidth": 1.4}
            axes.fill([a, b, c], [0.0, 1.0, 0.0], facecolor="none", **edge)
            handles.append(Patch(facecolor=color, label=label, **edge))
    axes.set_xlim(0.0, 1.1 * greatest)
    axes.set_ylim(0.0, 1.05)
    axes.set_box_aspect(0.7)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel(f"difficulty (compared by {problem.rank})")
    axes.set_ylabel("membership")
    axes.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.03), frameon=False, handlelength=3.0, handleheight=1.4
    )
