"""Python's way to the compiled collision tests of a scene: for tests, benchmarks and validation."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from genetics.operators import Table, pointers
from lowlevel.compiled import kernel
from problems.robots.collision_kernels import least_gap
from problems.robots.kinematics_kernels import place
from problems.robots.motion_kernels import is_configuration_free, is_way_free, make_room
from problems.robots.scene_kernels import scene_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from problems.robots.arm import Scene

Floats = NDArray[np.float64]
Flags = NDArray[np.uint8]


class Collisions:
    """The compiled tests of one scene. Not thread-safe in itself, but calls share nothing that changes.

    Configurations have shape (n,), in rad and m; several of them (m, n).
    """

    def __init__(self, scene: Scene) -> None:
        self._kept = [np.require(np.atleast_2d(_plain(each)), requirements=["C", "W"]) for each in scene.arrays()]
        self._table = pointers(*self._kept)  # addresses of the arrays kept above
        self._variables = scene.arm.limits.shape[0]
        self._bodies = scene.arm.kinds.size

    def frames(self, q: ArrayLike) -> Floats:
        """Return the placements of the bodies, row-major 3×4 matrices, shape (B, 12)."""
        frames = np.empty((self._bodies, 12))
        _place(self._rows(q)[0], frames, self._table)
        return frames

    def is_free(self, q: ArrayLike) -> bool:
        """Return whether a configuration keeps the scene's clearance from all obstacles and itself."""
        return bool(self.are_free(q)[0])

    def are_free(self, qs: ArrayLike) -> NDArray[np.bool_]:
        """Return which of several configurations are free, shape (m,)."""
        rows = self._rows(qs)
        free = np.empty(len(rows), np.uint8)
        _test(rows, free, self._table)
        return free.astype(np.bool_)

    def gap(self, q: ArrayLike, most: float = 1.0) -> float:
        """Return a lower bound of the least distance, at most ``most``, m; 0 for contact."""
        gaps = np.empty(1)
        _measure(self._rows(q), most, gaps, self._table)
        return float(gaps[0])

    def is_way_free(self, a: ArrayLike, b: ArrayLike) -> bool:
        """Return whether the straight segment between two configurations is proven free."""
        return bool(self.are_ways_free(a, b)[0])

    def are_ways_free(self, starts: ArrayLike, ends: ArrayLike) -> NDArray[np.bool_]:
        """Return which of several segments are proven free, shape (m,)."""
        rows, others = self._rows(starts), self._rows(ends)
        if rows.shape != others.shape:
            raise ValueError(f"expected as many ends as starts, found {len(others)} and {len(rows)}")
        free = np.empty(len(rows), np.uint8)
        _test_ways(rows, others, free, self._table)
        return free.astype(np.bool_)

    def _rows(self, qs: ArrayLike) -> Floats:
        rows = np.require(np.atleast_2d(np.asarray(qs, np.float64)), requirements=["C", "W"])
        if rows.shape[1] != self._variables:
            raise ValueError(f"expected configurations of {self._variables} numbers, found {rows.shape[1]}")
        return rows


def _plain(array: NDArray[np.generic]) -> NDArray[np.generic]:
    return array.astype(np.float64 if array.dtype.kind == "f" else np.int64)


@kernel("void(float64[::1], float64[:,::1], int64[:,::1])")
def _place(q: Floats, frames: Floats, table: Table) -> None:
    place(scene_of(table, 0), q, frames)


@kernel("void(float64[:,::1], uint8[::1], int64[:,::1])", may_be_long=True)
def _test(qs: Floats, free: Flags, table: Table) -> None:
    scene = scene_of(table, 0)
    room = make_room(scene)
    for row in range(free.size):
        free[row] = is_configuration_free(scene, qs[row], room)


@kernel("void(float64[:,::1], float64, float64[::1], int64[:,::1])", may_be_long=True)
def _measure(qs: Floats, most: float, gaps: Floats, table: Table) -> None:
    scene = scene_of(table, 0)
    room = make_room(scene)
    for row in range(gaps.size):
        place(scene, qs[row], room.frames)
        gaps[row] = least_gap(scene, room.frames, most, room.search)


@kernel("void(float64[:,::1], float64[:,::1], uint8[::1], int64[:,::1])", may_be_long=True)
def _test_ways(starts: Floats, ends: Floats, free: Flags, table: Table) -> None:
    scene = scene_of(table, 0)
    room = make_room(scene)
    for row in range(free.size):
        free[row] = is_way_free(scene, starts[row], ends[row], room)
