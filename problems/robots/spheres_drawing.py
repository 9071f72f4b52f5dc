"""A picture of a robot's meshes beside its bounding spheres."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.robots.arm import Arm
from problems.robots.pictures import shaded, triangles_under
from problems.robots.shapes import placed, sphere

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

EXCESS = 0.02  # m, by which a drawn sphere sticks out of its piece at most, unless it is a leaf
_MESH_COLOUR, _SPHERE_COLOUR = "#8fa3b5", "#d98b3a"


def draw_spheres(figure: Figure, arm: Arm) -> str:
    """Draw a robot's triangles and the spheres with an excess of `EXCESS`, and return how many there are, in words.

    The robot stands at zero, or where limits are nearest to it.
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    if not arm.pieces:
        raise BadInput(
            "--spheres: expected links with <collision> in the URDF, found none; copy <visual> to <collision>"
        )
    frames = _frames(arm)
    ball = sphere(1.0)
    meshes, balls = [], []
    for number, body in enumerate(arm.piece_body):
        triangles, spheres = _triangles(arm, number), spheres_at(arm, number, EXCESS)
        meshes.append(placed(frames[body], triangles))
        shapes = spheres[:, None, None, :3] + spheres[:, 3, None, None, None] * ball / np.abs(ball).max()
        balls.append(placed(frames[body], shapes.reshape(-1, 3, 3)))
    count = sum(len(each) for each in balls) // len(ball)
    points = np.concatenate(balls).reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    for place, (polygons, colour, title) in enumerate(
        [
            (np.concatenate(meshes), _MESH_COLOUR, f"{len(arm.triangles):,} triangles"),
            (np.concatenate(balls), _SPHERE_COLOUR, f"{count:,} of {len(arm.spheres):,} spheres"),
        ]
    ):
        axes = figure.add_subplot(1, 2, place + 1, projection="3d")
        axes.add_collection3d(Poly3DCollection(polygons, facecolors=shaded(polygons, colour)))
        for name, lowest, highest in zip("xyz", low, high, strict=True):
            getattr(axes, f"set_{name}lim")(lowest, highest)
            getattr(axes, f"set_{name}label")(f"{name} (m)")
        axes.set_box_aspect(tuple(high - low))
        axes.locator_params(nbins=4)
        axes.set_title(title, fontsize=10)
    return f"{len(arm.pieces)} links, {len(arm.triangles):,} triangles, {count:,} spheres at an excess of {EXCESS:g} m"


def spheres_at(arm: Arm, piece: int, excess: float) -> Floats:
    """Return spheres that contain a piece and stick out of it by at most an excess, unless they are leaves, (n, 4)."""
    from scipy.spatial import KDTree

    triangles = _triangles(arm, piece)
    surface = KDTree(np.concatenate([triangles.mean(axis=1), triangles.reshape(-1, 3)]))
    ball = np.unique(sphere(1.0).reshape(-1, 3), axis=0)
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    found, level = [np.empty((0, 4))], np.array([arm.piece_root[piece]])
    while len(level):
        spheres, below = arm.spheres[level], arm.children[level]
        away, _ = surface.query(spheres[:, None, :3] + spheres[:, 3, None, None] * ball)
        done = (below[:, 0] < 0) | (away.max(axis=1) <= excess)
        found.append(spheres[done])
        level = np.concatenate(
            [np.empty(0, np.int64), *(np.arange(first, first + count) for first, count in below[~done])]
        )
    return np.concatenate(found)


def _triangles(arm: Arm, piece: int) -> Floats:
    triangles: Floats = arm.triangles[triangles_under(arm, int(arm.piece_root[piece]))].reshape(-1, 3, 3)
    return triangles


def _frames(arm: Arm) -> Floats:
    """Return the frames of the bodies where each variable is 0 or at its nearest limit, shape (B, 12)."""
    from problems.robots.chain import frames_of

    frames: Floats = frames_of(arm, np.clip(0.0, *arm.limits.T)[None])[0]
    return frames
