"""The arrays of a robot's scene as compiled code sees them."""

from typing import Any, NamedTuple

from lowlevel.compiled import subroutine
from lowlevel.pointers import integers, reals
from problems.robots.arm import SCENE_ARRAYS

SCENE_PARTS = len(SCENE_ARRAYS)
"""The number of entries that a scene has in an operator's table."""


class Scene(NamedTuple):
    """A robot among obstacles: B bodies, n variables, L pieces, S spheres, T triangles, P pairs, O solids.

    The attributes are those of `problems.robots.arm.Arm` and `problems.robots.arm.Scene`.
    """

    parents: Any  # (B,)
    kinds: Any  # (B,)
    variables: Any  # (B,)
    scales: Any  # (B, 2)
    placements: Any  # (B, 12)
    axes: Any  # (B, 3)
    limits: Any  # (n, 2), rad or m
    reach: Any  # (B, n), m per unit of the variable
    piece_body: Any  # (L,)
    piece_root: Any  # (L,)
    spheres: Any  # (S, 4), m
    children: Any  # (S, 2)
    triangles: Any  # (T, 9), m
    pairs: Any  # (P, 2)
    solids: Any  # (O, 16)
    clearance: Any  # m


@subroutine
def scene_of(table: Any, first: Any) -> Any:
    """Return the scene whose arrays begin at entry ``first`` of an operator's table (`Scene.arrays` in arm.py)."""
    return Scene(
        integers(table, first)[0],
        integers(table, first + 1)[0],
        integers(table, first + 2)[0],
        reals(table, first + 3),
        reals(table, first + 4),
        reals(table, first + 5),
        reals(table, first + 6),
        reals(table, first + 7),
        integers(table, first + 8)[0],
        integers(table, first + 9)[0],
        reals(table, first + 10),
        integers(table, first + 11),
        reals(table, first + 12),
        integers(table, first + 13),
        reals(table, first + 14),
        reals(table, first + 15)[0, 0],
    )


@subroutine
def with_clearance(scene: Any, clearance: Any) -> Any:
    """Return the same scene with another clearance."""
    return Scene(
        scene.parents, scene.kinds, scene.variables, scene.scales, scene.placements, scene.axes, scene.limits,
        scene.reach, scene.piece_body, scene.piece_root, scene.spheres, scene.children, scene.triangles, scene.pairs,
        scene.solids, clearance,
    )  # fmt: skip
