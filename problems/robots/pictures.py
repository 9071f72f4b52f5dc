"""Pictures of robots among obstacles, drawn from the compact model onto axes in space."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from problems.robots import chain
from problems.robots.arm import BOX, SPHERE, Arm, Scene

Floats = NDArray[np.float64]
Shells = list[tuple[int, Floats]]

SOLID = "#b8a888"
_DIRECTIONS = 60  # in which the outermost points of a piece are drawn
_AROUND_IT = 0.4  # m, around the robot, of what surrounds it
_AROUND = 20  # corners of a cylinder or sphere


def frames_of(arm: Arm, configuration: Floats) -> Floats:
    """Return the frames of all bodies in the world at one configuration, shape (bodies, 3, 4)."""
    frames: Floats = chain.frames_of(arm, configuration[None])[0].reshape(-1, 3, 4)
    return frames


def shells_of(arm: Arm) -> Shells:
    """Return the body and the hull's triangles, shape (n, 3, 3), of each piece: few enough to be drawn many times."""
    pieces = zip(arm.piece_body, arm.piece_root, strict=True)
    return [(int(body), _hull(arm.triangles[_under(arm, root)])) for body, root in pieces]


def _under(arm: Arm, root: int) -> list[int]:
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


def draw_robot(axes: Any, arm: Arm, shells: Shells, configuration: Floats, color: str, alpha: float) -> Floats:
    """Draw the robot at a configuration; return the corners of what was drawn, m, shape (n, 3)."""
    frames = frames_of(arm, configuration)
    faces = np.concatenate([corners @ frames[body, :, :3].T + frames[body, :, 3] for body, corners in shells])
    axes.add_collection3d(Poly3DCollection(faces, facecolors=color, alpha=alpha, shade=True))
    corners: Floats = faces.reshape(-1, 3)
    return corners


def draw_solids(axes: Any, scene: Scene) -> Floats:
    """Draw boxes, cylinders and spheres; return their corners, m, shape (n, 3)."""
    seen = [np.empty((0, 3))]
    for solid in scene.solids:
        faces = [face @ solid[1:10].reshape(3, 3) + solid[10:13] for face in _faces(int(solid[0]), solid[13:])]
        # Matplotlib fills up faces of unlike lengths with undefined numbers, and scales the axes by these too.
        for count in sorted({len(face) for face in faces}):
            alike = [face for face in faces if len(face) == count]
            axes.add_collection3d(
                Poly3DCollection(alike, facecolors=SOLID, edgecolors="0.5", linewidths=0.3, alpha=0.35)
            )
        seen += faces
    return np.concatenate(seen)


def _faces(kind: int, half: Floats) -> list[Floats]:
    """Return the faces of a solid in its own frame; a sphere's are three discs."""
    bearing = np.arange(_AROUND) * (2.0 * np.pi / _AROUND)
    disc = np.column_stack([np.cos(bearing), np.sin(bearing), np.zeros(_AROUND)])
    if kind == BOX:
        square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        sides = [np.insert(square, axis, side, axis=1) for axis in range(3) for side in (-1.0, 1.0)]
        return [side * half for side in sides]
    if kind == SPHERE:
        return [np.roll(disc, shift, axis=1) * half for shift in range(3)]
    low, high = (disc + np.array([0.0, 0.0, side]) for side in (-1.0, 1.0))
    around = [np.array([low[k - 1], low[k], high[k], high[k - 1]]) for k in range(_AROUND)]
    return [face * half for face in (low, high, *around)]


def fit(axes: Any, robot: Floats, solids: Floats) -> None:
    """Show the robot and what is near it, with the same scale in all directions, and name the axes.

    Args:
        axes: axes in space.
        robot: points of the robot, m, shape (n, 3).
        solids: points of what surrounds it, m, shape (n, 3).
    """
    low, high = robot.min(axis=0) - _AROUND_IT, robot.max(axis=0) + _AROUND_IT
    inside = np.clip(np.concatenate([robot, solids]), low, high)
    low, high = inside.min(axis=0), inside.max(axis=0)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set_box_aspect(np.maximum(high - low, 1e-3))
    axes.set(xlabel="x / m", ylabel="y / m", zlabel="z / m")
