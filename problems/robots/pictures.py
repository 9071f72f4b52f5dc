"""Pictures of robots among obstacles, drawn from the compact model onto axes in space."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, withStroke
from matplotlib.ticker import MaxNLocator, MultipleLocator
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from mpl_toolkits.mplot3d.proj3d import proj_transform
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from problems.animation import Body
from problems.robots import chain
from problems.robots.animating import obstacles_of
from problems.robots.arm import Arm
from problems.robots.fields import MeshShape
from problems.robots.model import RobotModel
from problems.robots.shapes import cut_to_size
from problems.robots.viewpoint import viewpoint

Floats = NDArray[np.float64]
Color = tuple[float, float, float, float]
Shells = list[tuple[int, Floats]]

_STANDING = to_rgba("#9a9a9a", 0.9)
OBSTACLES = tuple(mpl.colormaps["tab20"](each) for each in (2, 8, 10, 12, 16, 18, 3, 9, 11, 13, 17, 19))
"""The colors of obstacles: those of tab20 that are no color of a start, a goal, a way or a robot that stands still."""
_SOLID = 0.3  # how opaque obstacles are
_DIRECTIONS = 100  # in which the outermost points of a piece are drawn
_AROUND_IT = 0.4  # m, around the robot, of what surrounds it
_PARTS = 16  # triangles across the picture at least: large ones cannot be sorted by their distance
_LITTLE = 0.15  # of the longest way of any part: what moves less is drawn as what stands
_FILLED = np.array([0.95, 0.82])  # of the axes' width and height at most, which leaves room for the names of the axes
_MOST_NAMED = 8  # obstacles in a legend
_LIGHT = np.array([0.35, -0.5, 0.8])


@dataclass(frozen=True, eq=False)
class Pose:
    """The robot at a configuration.

    Attributes:
        configuration: rad or m, shape (n,).
        color: of what moves.
        alpha: how opaque it is.
        name: the name in the legend; none if empty.
    """

    configuration: Floats
    color: str
    alpha: float
    name: str = ""


@dataclass(frozen=True, eq=False)
class _Paint:
    """Triangles, m, shape (n, 3, 3), and their color with its opacity."""

    faces: Floats
    color: Color


def frames_of(arm: Arm, configuration: Floats) -> Floats:
    """Return the frames of all bodies in the world at one configuration, shape (bodies, 3, 4)."""
    frames: Floats = chain.frames_of(arm, configuration[None])[0].reshape(-1, 3, 4)
    return frames


def shells_of(arm: Arm) -> Shells:
    """Return the body and the hull's triangles, shape (n, 3, 3), of each piece: few enough to be drawn many times."""
    pieces = zip(arm.piece_body, arm.piece_root, strict=True)
    return [(int(body), _hull(arm.triangles[triangles_under(arm, root)])) for body, root in pieces]


def triangles_under(arm: Arm, root: int) -> list[int]:
    """Return the triangles under a sphere of a tree."""
    found: list[int] = []
    left = [int(root)]
    while left:
        first, count = (int(each) for each in arm.children[left.pop()])
        if first < 0:
            found += range(-first - 1, -first - 1 + count)
        else:
            left += range(first, first + count)
    return found


def _hull(triangles: Floats) -> Floats:
    """Return the triangles of a hull of some outermost points: few, since a picture has many such hulls."""
    points = triangles.reshape(-1, 3)
    # Directions evenly spread over a sphere, by the golden angle.
    height = 1.0 - (2.0 * np.arange(_DIRECTIONS) + 1.0) / _DIRECTIONS
    bearing, across = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(_DIRECTIONS), np.sqrt(1.0 - height**2)
    directions = np.column_stack([across * np.cos(bearing), across * np.sin(bearing), height])
    outermost = points[np.unique(np.argmax(points @ directions.T, axis=0))]
    try:
        hull: Floats = outermost[ConvexHull(outermost).simplices]
    except QhullError:  # flat, or a single point
        hull = triangles.reshape(-1, 3, 3)
    return hull


# The scene ------------------------------------------------------------------------------------------------------------
def draw_scene(axes: Any, problem: RobotModel, poses: Sequence[Pose], ways: Sequence[Floats]) -> None:
    """Draw a robot at several poses among its obstacles, seen from where its ways look long and little is hidden.

    Args:
        axes: axes in space; what is drawn there already lies in front and is named in the legend.
        problem: the robot and its obstacles.
        poses: where the robot is drawn.
        ways: lines that the picture looks across and has room for, m, shape (n, 3) each.
    """
    arm, obstacles = problem.scene.arm, obstacles_of(problem.robot, problem.obstacles)
    meshes = sum(isinstance(each, MeshShape) for each in problem.obstacles)
    shells = shells_of(arm)[: len(arm.pieces) - meshes]
    places = [_placed(arm, shells, pose.configuration) for pose in poses]
    parts = [faces for each in places for faces in each]
    box = _box(np.concatenate([np.concatenate(parts).reshape(-1, 3), *ways]), obstacles)
    spacing = float((box[1] - box[0]).max()) / _PARTS
    robot = _paints_of_robot(poses, places, spacing)
    around, edges = _paints_of_obstacles(obstacles, box, spacing)
    _paint(axes, [*robot, *around], edges)
    _look(axes, robot, around, ways, _bones(arm, poses), spacing)
    _fit(axes, box)
    shown = [each.name if len(paint.faces) else "" for each, paint in zip(obstacles, around, strict=True)]
    _draw_legend(axes, poses, any(each.color == _STANDING for each in robot), shown)


def _paints_of_robot(poses: Sequence[Pose], places: Sequence[Sequence[Floats]], spacing: float) -> list[_Paint]:
    """Return each shell at each pose. What moves little has the color of what stands, and what stands is there once."""
    ways = np.array([np.linalg.norm(np.ptp(each, axis=0), axis=-1).max() for each in zip(*places, strict=True)])
    moves = ways >= _LITTLE * ways.max()
    return [
        _Paint(cut_to_size(faces, spacing), to_rgba(pose.color, pose.alpha) if moves[shell] else _STANDING)
        for number, (pose, shells) in enumerate(zip(poses, places, strict=True))
        for shell, faces in enumerate(shells)
        if number == 0 or ways[shell] > 0.0
    ]


def _paints_of_obstacles(obstacles: Sequence[Body], box: Floats, spacing: float) -> tuple[list[_Paint], list[_Paint]]:
    """Return obstacles, and their edges as triangles without area, which are sorted by distance like the others."""
    solids, edges = [], []
    for number, each in enumerate(obstacles):
        solids.append(_Paint(_cut(each.vertices[each.triangles], box, spacing), color_of(number)))
        edges.append(_Paint(_cut(each.edges[:, [0, 1, 1]], box, spacing), (*color_of(number)[:3], 1.0)))
    return solids, edges


def _look(
    axes: Any,
    robot: Sequence[_Paint],
    around: Sequence[_Paint],
    ways: Sequence[Floats],
    bones: Sequence[Floats],
    spacing: float,
) -> None:
    """Look across ways and bones from a side on which little hides the ways and what moves."""
    surface = np.concatenate([each.faces.mean(axis=1) for each in (*robot, *around)])
    seen = np.concatenate([*ways, *(each.faces.mean(axis=1) for each in robot if each.color != _STANDING)])
    axes.view_init(*viewpoint([*ways, *bones], seen, surface, spacing))


def color_of(obstacle: int) -> Color:
    """Return the color of an obstacle by its number in the file."""
    return to_rgba(OBSTACLES[obstacle % len(OBSTACLES)], _SOLID)


def draw_line(axes: Any, points: Floats, color: str, **style: Any) -> None:
    """Draw a line in front of all solids, m, shape (n, 3), with a pale border that sets it off."""
    around = [withStroke(linewidth=4.5, foreground="white", alpha=0.8), Normal()]
    axes.plot(*points.T, color=color, linewidth=2.2, zorder=3, path_effects=around, **style)


def _placed(arm: Arm, shells: Shells, configuration: Floats) -> list[Floats]:
    """Return the triangles of each shell at a configuration, m, shape (n, 3, 3)."""
    frames = frames_of(arm, configuration)
    return [corners @ frames[body, :, :3].T + frames[body, :, 3] for body, corners in shells]


def _bones(arm: Arm, poses: Sequence[Pose]) -> list[Floats]:
    """Return the lines between joints at the first two poses, m, shape (2, 3) each."""
    places = [frames_of(arm, pose.configuration)[:, :, 3] for pose in poses[:2]]
    return [each[[parent, body]] for each in places for body, parent in enumerate(arm.parents) if parent > 0]


def _box(points: Floats, obstacles: Sequence[Body]) -> Floats:
    """Return the lowest and highest corner, shape (2, 3), around points and what is near them of the obstacles."""
    points = points.reshape(-1, 3)
    low, high = points.min(axis=0) - _AROUND_IT, points.max(axis=0) + _AROUND_IT
    inside = np.concatenate([points, *(np.clip(each.vertices, low, high) for each in obstacles)])
    return np.array([inside.min(axis=0), inside.max(axis=0)])


def _cut(soup: Floats, box: Floats, longest: float) -> Floats:
    """Return triangles in parts with no edge longer than ``longest``, m, without those outside a box."""
    for length in (16.0 * longest, 4.0 * longest, longest):  # in steps, as an obstacle may be much larger than the box
        soup = cut_to_size(soup, length)
        soup = soup[(soup.max(axis=1) > box[0] - 1e-9).all(axis=1) & (soup.min(axis=1) < box[1] + 1e-9).all(axis=1)]
    return soup


def _paint(axes: Any, solids: Sequence[_Paint], edges: Sequence[_Paint]) -> None:
    """Draw all as one collection: matplotlib sorts by distance only what is in the same one."""
    parts = [*solids, *edges]
    colors = np.concatenate([shaded(each.faces, each.color[:3], each.color[3]) for each in parts])
    inks = colors.copy()
    inks[: sum(len(each.faces) for each in solids), 3] = 0.0
    faces = np.concatenate([each.faces for each in parts])
    axes.computed_zorder = False  # lines are drawn in front
    style = {"facecolors": colors, "edgecolors": inks, "linewidths": 0.7, "zorder": 1}
    # As dots: thousands of triangles would make an SVG of megabytes, which every viewer draws slowly.
    axes.add_collection3d(Poly3DCollection(faces, rasterized=True, **style))


def shaded(faces: Floats, color: Any, alpha: float = 1.0) -> Floats:
    """Return a color for each triangle, shape (n, 4), lighter where it faces the light."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-12)
    facing = np.abs(normals @ _LIGHT) / length / np.linalg.norm(_LIGHT)
    colors: Floats = np.column_stack(
        [(0.5 + 0.5 * facing)[:, None] * np.array(to_rgb(color)), np.full(len(faces), alpha)]
    )
    return colors


def _fit(axes: Any, box: Floats) -> None:
    """Show what is in a box, with the same scale and the same steps of ticks in all directions, and name the axes."""
    size = np.maximum(box[1] - box[0], 1e-3)
    step = float(np.diff(MaxNLocator(8, steps=[1, 2, 5, 10]).tick_values(0.0, size.max()))[0])
    for name, low, high in zip("xyz", *box, strict=True):
        axes.set(**{f"{name}lim": (low, high), f"{name}label": f"{name} / m"})
        axis = getattr(axes, f"{name}axis")
        axis.set_major_locator(MultipleLocator(step))
        axis.set_rotate_label(False)
        axis.labelpad = 8.0
    axes.set_box_aspect(size)
    corners = np.array(list(itertools.product(*box.T)))
    x, y, _ = proj_transform(*corners.T, axes.get_proj())
    filled = np.ptp(axes.transLimits.transform(np.column_stack([x, y])), axis=0)
    axes.set_box_aspect(size, zoom=(_FILLED / filled).min())


def _draw_legend(axes: Any, poses: Sequence[Pose], is_standing: bool, obstacles: Sequence[str]) -> None:
    """Name poses, what stands, lines, and those obstacles that have a name here, below the axes."""
    handles = [Patch(color=pose.color, alpha=max(pose.alpha, 0.25), label=pose.name) for pose in poses if pose.name]
    handles += [Patch(color=_STANDING, label="nearly the same in all")] if is_standing else []
    handles += axes.get_legend_handles_labels()[0]
    named = [Patch(color=color_of(n)[:3], alpha=0.6, label=name) for n, name in enumerate(obstacles) if name]
    if len(named) > _MOST_NAMED:
        more = len(named) - _MOST_NAMED + 1
        named[-more:] = [Patch(color="none", label=f"and {more} more obstacles")]
    axes.figure.legend(handles=handles + named, loc="outside lower center", ncols=4, frameon=False, fontsize="small")
