"""Pictures of sphere-path: the path among spheres (the paper's figure), or the vehicle in its world."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.collections import PatchCollection
from matplotlib.colors import LightSource
from matplotlib.patches import Circle, Polygon
from matplotlib.patheffects import withStroke
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray

from problems.plane import draw_obstacles
from problems.problem import Populations, Solution
from problems.sphere_path.pose import rotations

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from problems.sphere_path.model import SpherePathModel

Floats = NDArray[np.float64]

PATH = "#1f5fa8"
START = "#2a8c4a"
GOAL = "#c8321e"
SPHERE = "0.55"
BALL = "#d8c9a3"
OTHERS = "#b59adf"
_MOST_OTHERS = 16  # paths of the last generation that are drawn
_POSES = 40  # poses of a vehicle along its path, in the plane
_SOLIDS = 12  # poses of a vehicle along its path, in space
_MOST_FACES = 4000  # of a solid; of more faces only every n-th is drawn
_PIXELS = 120  # of a projection, in each direction


def _unit_ball() -> Floats:
    """Return the faces of a ball of radius 1 about the origin, shape (n, 4, 3)."""
    around, across = np.meshgrid(np.linspace(0.0, 2.0 * np.pi, 17), np.linspace(0.0, np.pi, 9), indexing="ij")
    ball = np.stack([np.cos(around) * np.sin(across), np.sin(around) * np.sin(across), np.cos(across)], axis=-1)
    return np.stack([ball[:-1, :-1], ball[1:, :-1], ball[1:, 1:], ball[:-1, 1:]], axis=2).reshape(-1, 4, 3)


_BALL = _unit_ball()


def draw(problem: SpherePathModel, figure: Figure, solution: Solution | None, populations: Populations) -> None:
    """Fill an empty figure; see `problems.problem.Problem.draw`."""
    figure.set_layout_engine("constrained")
    path = None if solution is None else np.array(solution["path"])
    others = _others(problem, populations)
    if problem.mesh is not None or (problem.vehicle is None and len(problem.start) == 3):
        figure.set_size_inches(8.5, 7.5)
        axes = figure.add_subplot(projection="3d")
        _draw_space(problem, axes, path, others)
    elif problem.vehicle is not None:
        _draw_floor(problem, figure, path)
    else:
        _draw_projections(problem, figure, path, others)
    figure.suptitle(_title(solution))


def _title(solution: Solution | None) -> str:
    if solution is None:
        return "no path found"
    crossed = solution["crossed"]
    return f"length {solution['length']:.4g}, crosses {crossed if crossed else 'no'} sphere{'s' * (crossed != 1)}"


def _others(problem: SpherePathModel, populations: Populations) -> Floats:
    """Return some paths of the last generation, (n, rows, axes)."""
    if not populations:
        return np.empty((0, 2, len(problem.start)))
    # Individuals of a late generation are often copies of each other; each path is drawn once.
    last = np.unique(populations[max(populations)], axis=0)
    return problem.paths(last[:: max(1, -(-len(last) // _MOST_OTHERS))])[0]


def _pieces(problem: SpherePathModel, path: Floats) -> list[Floats]:
    """Return the segments of a path, shifted into the bounds.

    A segment that leaves the bounds along a periodic axis appears twice: shifted as its beginning, and as its end.
    """
    pieces = []
    low, high = problem.space.bounds.T
    turns = np.where(problem.space.periodic, high - low, 0.0)
    for begin, end in pairwise(path):
        for row in (begin, end):
            # Whole periods only, along periodic axes only.
            shift = turns * np.floor((row - low) / (high - low)) * (turns > 0.0)
            pieces.append(np.array([begin - shift, end - shift]))
    return pieces


# Spheres in two dimensions at a time ---------------------------------------------------------------------------------
def _draw_projections(problem: SpherePathModel, figure: Figure, path: Floats | None, others: Floats) -> None:
    """Draw a panel for each pair of neighbouring axes."""
    count = len(problem.start) - 1
    columns = min(3, count)
    rows = -(-count // columns)
    figure.set_size_inches(max(6.5, 4.2 * columns), max(6.5 if count == 1 else 4.2, 4.0 * rows) + 0.4)
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for panel in panels[count:]:
        panel.set_axis_off()
    for first, axes in enumerate(panels[:count]):
        _draw_projection(problem, axes, first, path, others)
    panels[0].legend(loc="upper left", fontsize="small")


def _draw_projection(problem: SpherePathModel, axes: Axes, first: int, path: Floats | None, others: Floats) -> None:
    pair = [first, first + 1]
    _draw_discs(problem, axes, pair)
    for other in others:
        for piece in _pieces(problem, other):
            axes.plot(*piece[:, pair].T, color=OTHERS, linewidth=0.7, alpha=0.6)
    if path is not None:
        for piece in _pieces(problem, path):
            axes.plot(*piece[:, pair].T, color=PATH, linewidth=2.0, zorder=4)
        if not problem.space.periodic.any():
            axes.plot(*path[1:-1, pair].T, "o", color="white", markeredgecolor=PATH, markersize=5, zorder=5)
    for place, color, name in ((problem.start, START, "start"), (problem.goal, GOAL, "goal")):
        axes.plot(*np.array(place)[pair], "o", color=color, markersize=9, markeredgecolor="white", zorder=6, label=name)
    axes.set(xlim=problem.bounds[first], ylim=problem.bounds[first + 1])
    axes.set(xlabel=f"axis {first + 1}", ylabel=f"axis {first + 2}")
    axes.set_aspect("equal")


def _draw_discs(problem: SpherePathModel, axes: Axes, pair: list[int]) -> None:
    """Draw the spheres in the plane; with more axes, how many of them lie above each place, since some hide others."""
    spheres = problem.obstacle_spheres[:, [*pair, -1]]
    if len(problem.start) == 2:
        discs = [Circle((x, y), radius) for x, y, radius in spheres]
        axes.add_collection(PatchCollection(discs, facecolor=SPHERE, edgecolor="0.35", linewidth=0.5, alpha=0.75))
        return
    low, high = problem.space.bounds[pair].T
    places = low + (high - low) * (np.arange(_PIXELS)[:, None] + 0.5) / _PIXELS
    above = np.zeros((_PIXELS, _PIXELS))
    for x, y, radius in spheres:
        above += (places[:, 1, None] - y) ** 2 + (places[None, :, 0] - x) ** 2 < radius**2
    extent = (low[0], high[0], low[1], high[1])
    axes.imshow(above, extent=extent, origin="lower", cmap="Greys", vmin=0.0, vmax=1.8 * max(1.0, float(above.max())))


# Three dimensions -----------------------------------------------------------------------------------------------------
def _draw_space(problem: SpherePathModel, axes: Any, path: Floats | None, others: Floats) -> None:
    axes.computed_zorder = False
    if problem.mesh is not None:
        _draw_solid(axes, problem.mesh.triangles, SPHERE, 0.35, 1)
    else:
        _draw_spheres(axes, problem.obstacle_spheres)
        for other in others:
            for piece in _pieces(problem, other):
                axes.plot(*piece.T, color=OTHERS, linewidth=0.7, alpha=0.6, zorder=2)
    if path is not None:
        _draw_path(problem, axes, path)
    for place, color, name in ((problem.start, START, "start"), (problem.goal, GOAL, "goal")):
        _draw_vehicle(problem, axes, np.array(place), color, 0.5)
        axes.plot(*[[each] for each in place[:3]], "o", color=color, markersize=9, markeredgecolor="white", zorder=6)
        axes.text(*place[:3], f"  {name}", color=color, weight="bold", zorder=7)
    _frame_space(problem, axes)


def _frame_space(problem: SpherePathModel, axes: Any) -> None:
    """Set the limits of the axes: the bounds, and for a vehicle also what of it and its mesh reaches beyond them."""
    (low, high), names = problem.space.bounds[:3].T, [f"axis {number}" for number in (1, 2, 3)]
    if problem.vehicle is not None and problem.mesh is not None:
        corners = problem.mesh.triangles.reshape(-1, 3)
        low = np.minimum(low - problem.vehicle.reach, corners.min(axis=0))
        high = np.maximum(high + problem.vehicle.reach, corners.max(axis=0))
        names = [f"{name} / m" for name in "xyz"]
    for name, least, greatest, label in zip("xyz", low, high, names, strict=True):
        axes.set(**{f"{name}lim": (least, greatest), f"{name}label": label})
    axes.set_box_aspect(high - low)
    axes.view_init(24, -58)


def _draw_vehicle(problem: SpherePathModel, axes: Any, pose: Floats, color: str, alpha: float) -> None:
    """Draw a solid or a ball at a pose."""
    if problem.vehicle is None:
        return
    if problem.vehicle.radius is not None:
        _draw_faces(axes, _BALL * problem.vehicle.radius + pose[:3], color, alpha, 3)
    elif problem.vehicle.mesh is not None:
        turned = problem.vehicle.mesh.triangles @ rotations(pose[None, 3:], 3)[0].T + pose[:3]
        _draw_solid(axes, turned, color, alpha, 3)


def _draw_path(problem: SpherePathModel, axes: Any, path: Floats) -> None:
    for pose in _along(path, problem.space.scale, _SOLIDS)[1:-1]:
        _draw_vehicle(problem, axes, pose, PATH, 0.25)
    for piece in _pieces(problem, path):
        axes.plot(*piece[:, :3].T, color=PATH, linewidth=2.2, zorder=4)
    axes.plot(*path[1:-1, :3].T, "o", color="white", markeredgecolor=PATH, markersize=5, zorder=5)


def _draw_solid(axes: Any, triangles: Floats, color: str, alpha: float, zorder: float) -> None:
    _draw_faces(axes, triangles[:: max(1, len(triangles) // _MOST_FACES)], color, alpha, zorder)


def _draw_faces(axes: Any, faces: Floats, color: str, alpha: float, zorder: float) -> None:
    solid = Poly3DCollection(faces, facecolors=[color], linewidth=0, alpha=alpha, shade=True, zorder=zorder)
    axes.add_collection3d(solid)


def _draw_spheres(axes: Any, spheres: Floats) -> None:
    """Draw all spheres as one body of many faces, so that matplotlib sorts the faces of all of them by depth."""
    shown = np.concatenate([np.empty((0, 4, 3)), *(_BALL * radius + centre for *centre, radius in spheres)])
    body = Poly3DCollection(
        shown,
        facecolors=[BALL],
        linewidth=0,
        alpha=0.3,
        shade=True,
        lightsource=LightSource(225, 45),
        zorder=1,
    )
    axes.add_collection3d(body)


# A vehicle in the plane -----------------------------------------------------------------------------------------------
def _draw_floor(problem: SpherePathModel, figure: Figure, path: Floats | None) -> None:
    (x0, x1), (y0, y1) = problem.bounds[:2]
    figure.set_size_inches(9.5, float(np.clip(9.5 * (y1 - y0) / (x1 - x0), 3.5, 14.0)) + 0.9)
    axes = figure.subplots()
    draw_obstacles(axes, problem.obstacles)
    if path is not None:
        bodies = [_body(problem, pose) for pose in _along(path, problem.space.scale, _POSES)]
        axes.add_collection(PatchCollection(bodies, facecolor=PATH, alpha=0.10, edgecolor="none", zorder=3))
        axes.add_collection(
            PatchCollection(bodies, facecolor="none", edgecolor=PATH, alpha=0.5, linewidth=0.7, zorder=3)
        )
        axes.plot(*path[:, :2].T, color=PATH, linewidth=1.8, zorder=4)
        axes.plot(*path[1:-1, :2].T, "o", color="white", markeredgecolor=PATH, markersize=5, zorder=5)
    for place, color, name in ((problem.start, START, "start"), (problem.goal, GOAL, "goal")):
        body = _body(problem, np.array(place))
        body.set(facecolor=color, alpha=0.85, edgecolor="white", zorder=6)
        axes.add_patch(body)
        label = axes.text(place[0], place[1], name, ha="center", va="center", color=color, weight="bold", zorder=8)
        label.set_path_effects([withStroke(linewidth=3.5, foreground="white")])
    _frame(axes, x0, x1, y0, y1, problem.space.scale)


def _frame(axes: Axes, x0: float, x1: float, y0: float, y1: float, scale: Floats) -> None:
    """Draw the bounds, which are those of the vehicle's reference point, with a margin for what reaches beyond."""
    axes.add_patch(Polygon([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], fill=False, edgecolor="0.6", linestyle=":"))
    margin = 0.6 * float(scale.max()) if len(scale) > 2 else 0.03 * (x1 - x0)
    axes.set(xlim=(x0 - margin, x1 + margin), ylim=(y0 - margin, y1 + margin), xlabel="x / m", ylabel="y / m")
    axes.set_aspect("equal")


def _body(problem: SpherePathModel, pose: Floats) -> Circle | Polygon:
    assert problem.vehicle is not None, "a floor is there for a vehicle"
    if problem.vehicle.vertices is None:
        return Circle((pose[0], pose[1]), problem.vehicle.reach)
    turn = rotations(pose[None, 2:], 2)[0]
    return Polygon(np.array(problem.vehicle.vertices) @ turn.T + pose[:2], closed=True)


def _along(path: Floats, scale: Floats, count: int) -> Floats:
    """Return poses equally spaced along the path by its length; its nodes need not be among them."""
    lengths = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path * scale, axis=0), axis=1))])
    if lengths[-1] == 0.0:
        return path[:1]
    places = np.linspace(0.0, lengths[-1], count)
    return np.column_stack([np.interp(places, lengths, axis) for axis in path.T])
