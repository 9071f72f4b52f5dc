"""Solutions as rigid bodies that move in space, for screens that turn a planner's solution in space.

A planner converts its solution to an `Animation` (`problems.problem.Problem.animation`); those who show it know nothing
else. A placement is a row-major 3×4 matrix [R | p], shape (12,).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Role = Literal["robot", "attached", "obstacle"]

WORLD = 0
"""The frame of what stands still."""
_SHARP = np.cos(np.radians(28.0))  # between the normals of two triangles whose common edge is drawn
_ROUND = 1e-4  # m, vertices that are nearer are one


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid body with a surface of triangles.

    Attributes:
        name: what it is called, such as the name of a link.
        role: what it is, which decides its color.
        frame: the number of the frame with which it moves; `WORLD` if it stands still.
        vertices: points in that frame, m, shape (V, 3).
        triangles: the numbers of their corners, shape (T, 3).
    """

    name: str
    role: Role
    frame: int
    vertices: Floats
    triangles: Integers

    @staticmethod
    def of_soup(name: str, role: Role, frame: int, soup: Floats) -> Body:
        """Return a body of triangles that are given by their corners, shape (T, 3, 3), m."""
        vertices, triangles = joined(soup)
        return Body(name, role, frame, vertices, triangles)

    @property
    def edges(self) -> Floats:
        """The ends of its sharp edges, m, shape (E, 2, 3): a box has twelve, a sphere none."""
        return self.vertices[sharp_edges(self.vertices, self.triangles)]


@dataclass(frozen=True, eq=False)
class Ghost:
    """A pale copy of all that moves, such as the robot at the start of its path.

    Attributes:
        name: ``"start"``, ``"goal"``, or another name for people.
        frames: the placement of each frame, shape (F, 12).
    """

    name: str
    frames: Floats


@dataclass(frozen=True, eq=False)
class Animation:
    """Bodies and their places at a number of steps.

    Attributes:
        bodies: all bodies. They are the same for all solutions of a problem.
        frames: the placement of each frame at each step, shape (steps, F, 12). Frame `WORLD` is always the identity.
        along: the time of each step, or another quantity that increases, shape (steps,).
        along_name: the name of that quantity with its unit, such as ``"time / s"``; ``"solution"`` for steps that are
            solutions side by side.
        ghosts: pale copies, such as those at start and goal.
        lines: the ways of points of interest, m, shape (steps, 3) each.
        targets: placements that are to be reached, shape (n, 12).
        names: the names of the curves, such as joints.
        curves: their values at each step, shape (steps, len(names)).
        curves_name: what the values are, such as ``"joint / rad"``.
    """

    bodies: tuple[Body, ...]
    frames: Floats
    along: Floats
    along_name: str
    ghosts: tuple[Ghost, ...] = ()
    lines: tuple[Floats, ...] = ()
    targets: Floats = field(default_factory=lambda: np.empty((0, 12)))
    names: tuple[str, ...] = ()
    curves: Floats = field(default_factory=lambda: np.empty((0, 0)))
    curves_name: str = ""

    def complaint(self) -> str | None:
        """Return what is expected, if the arrays do not fit each other or are not finite; None if all is well."""
        steps = len(self.frames)
        if not steps or self.frames.ndim != 3 or self.frames.shape[2] != 12 or not self.bodies:
            return "bodies, and frames of shape (steps, F, 12)"
        count = self.frames.shape[1]
        if self.along.shape != (steps,) or any(line.shape != (steps, 3) for line in self.lines):
            return "one number of along, and one point of each line, for each step"
        if self.names and self.curves.shape != (steps, len(self.names)):
            return "one value of each curve for each step"
        if any(ghost.frames.shape != (count, 12) for ghost in self.ghosts):
            return "ghosts with as many frames as the steps have"
        for body in self.bodies:
            corners = body.triangles
            if (
                not 0 <= body.frame < count
                or not len(corners)
                or not 0 <= corners.min() <= corners.max() < len(body.vertices)
            ):
                return f"bodies whose frames and corners are there, unlike {body.name}"
        arrays = [self.frames, self.along, self.curves, self.targets, *self.lines]
        arrays += [each.frames for each in self.ghosts] + [each.vertices for each in self.bodies]
        return None if all(np.isfinite(each).all() for each in arrays) else "finite numbers"

    def box(self, margin: float) -> Floats:
        """Return the lowest and highest coordinates of what to show, m, shape (2, 3).

        This is all that moves, and what stands still where it is nearer to that than a margin, m.
        """
        moving = [each for each in self.bodies if each.role != "obstacle"] or list(self.bodies)
        places = np.concatenate([self.frames, *(ghost.frames[None] for ghost in self.ghosts)])
        points = [placed(places[:, body.frame], body.vertices).reshape(-1, 3) for body in moving]
        seen = np.concatenate([*points, self.targets.reshape(-1, 3, 4)[:, :, 3], *self.lines])
        low, high = seen.min(axis=0) - margin, seen.max(axis=0) + margin
        still = [np.clip(body.vertices, low, high) for body in self.bodies if body.frame == WORLD]
        every = np.concatenate([seen, *still])
        return np.array([every.min(axis=0), every.max(axis=0)])


def placed(placements: Floats, points: Floats) -> Floats:
    """Return points at each placement: (.., 12) and (n, 3) to (.., n, 3)."""
    matrices = placements.reshape(*placements.shape[:-1], 3, 4)
    moved: Floats = points @ np.swapaxes(matrices[..., :3], -1, -2) + matrices[..., None, :, 3]
    return moved


def joined(soup: Floats) -> tuple[Floats, Integers]:
    """Return vertices (V, 3) and triangles (T, 3) of separate triangles (T, 3, 3), without those of no area."""
    _, first, which = np.unique(
        np.round(soup.reshape(-1, 3) / _ROUND).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    triangles = which.reshape(-1, 3)
    one, two, three = triangles.T
    return soup.reshape(-1, 3)[first], triangles[(one != two) & (two != three) & (one != three)].astype(np.int64)


def coarsened(vertices: Floats, triangles: Integers, most: int) -> tuple[Floats, Integers]:
    """Return a surface of at most so many triangles: vertices that share a cell of a grid become their mean.

    Only for pictures: the surface is moved by up to a cell, to either side.
    """
    extent = float(np.ptp(vertices, axis=0).max())
    cells, found, corners = 128.0, vertices, triangles
    while len(corners) > most:
        keys = np.floor((vertices - vertices.min(axis=0)) / max(extent / cells, 1e-12)).astype(np.int64)
        _, which, counts = np.unique(keys, axis=0, return_inverse=True, return_counts=True)
        which = which.reshape(-1)
        found = np.stack([np.bincount(which, axis) for axis in vertices.T], axis=1) / counts[:, None]
        corners = which[triangles]
        one, two, three = corners.T
        corners = corners[(one != two) & (two != three) & (one != three)]
        _, first = np.unique(np.sort(corners, axis=1), axis=0, return_index=True)
        corners = corners[np.sort(first)].astype(np.int64)
        cells /= 1.3
    return found, corners


def sharp_edges(vertices: Floats, triangles: Integers) -> Integers:
    """Return the edges where a surface has a fold or ends, as numbers of vertices, shape (E, 2)."""
    one, two, three = (vertices[corners] for corners in triangles.T)
    normals = np.cross(two - one, three - one)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    owners = np.tile(np.arange(len(triangles)), 3)
    edges, which = np.unique(sides, axis=0, return_inverse=True)
    which = which.reshape(-1)
    order = np.argsort(which, kind="stable")
    starts = np.searchsorted(which[order], np.arange(len(edges)))
    counts = np.bincount(which, minlength=len(edges))
    first, last = owners[order[starts]], owners[order[starts + counts - 1]]
    # The triangles may be wound either way round, so only the size of the cosine counts.
    flat = (counts == 2) & (np.abs((normals[first] * normals[last]).sum(axis=1)) > _SHARP)
    found: Integers = edges[~flat].astype(np.int64)
    return found
