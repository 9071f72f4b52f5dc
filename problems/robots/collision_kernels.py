"""The compiled test of a configuration: whether a robot keeps clear of all solids, mesh obstacles and itself.

A piece's tree of spheres is searched against a solid, or two trees against each other (`problems.robots.tree_kernels`).
Distances are lower bounds, so "free" is never wrong. Roots are compared first, and the pairs that overlap most are
searched first, because a contact ends the search.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import inlined, subroutine
from problems.robots.solid_kernels import distance_from_solid
from problems.robots.tree_kernels import (
    into_body,
    into_solid,
    make_tree_room,
    piece_from_piece,
    piece_from_solid,
    piece_is_within,
    solid_is_within,
)

BLOCKED, NEAR, FREE = 0, 1, 2
"""Verdicts: contact; free, but not by the margins asked for; free by these margins."""
TOUCH = 2e-6
"""Distances up to this, m, count as contact. Coal, which proves solutions, reports contact below 1e-6 m."""


class Search(NamedTuple):
    """The working arrays of a test; each test overwrites them."""

    centres: Any  # (L, 3): the centres of the roots in the world, m
    keys: Any  # (candidates,): how little the roots of a candidate overlap
    which: Any  # (candidates, 2): a piece and a solid; or a pair of pieces, and 0
    trees: Any  # the working arrays of `piece_from_solid` and `piece_from_piece`


@subroutine
def make_search(scene: Any) -> Any:
    """Return working arrays for `verdict` and `least_gap`."""
    most = max(scene.pairs.shape[0], scene.piece_body.size * scene.solids.shape[0], 1)
    return Search(
        np.empty((scene.piece_body.size, 3)),
        np.empty(most),
        np.empty((most, 2), np.int64),
        make_tree_room(),
    )


@inlined
def _place_roots(scene: Any, frames: Any, centres: Any) -> Any:
    """Fill the centres of the pieces' root spheres in the world."""
    for piece in range(scene.piece_body.size):
        frame, root = frames[scene.piece_body[piece]], scene.spheres[scene.piece_root[piece]]
        x, y, z = root[0], root[1], root[2]
        for axis in range(3):
            centres[piece, axis] = (
                frame[4 * axis] * x + frame[4 * axis + 1] * y + frame[4 * axis + 2] * z + frame[4 * axis + 3]
            )


@inlined
def _root_from_solid(centre: Any, solid: Any) -> Any:
    """Return the signed distance of a point in the world from a solid."""
    x, y, z = centre[0] - solid[10], centre[1] - solid[11], centre[2] - solid[12]
    return distance_from_solid(
        np.int64(solid[0]),
        solid[1] * x + solid[2] * y + solid[3] * z,
        solid[4] * x + solid[5] * y + solid[6] * z,
        solid[7] * x + solid[8] * y + solid[9] * z,
        solid[13],
        solid[14],
        solid[15],
    )


@inlined
def _between(centres: Any, one: Any, other: Any) -> Any:
    """Return the distance between the centres of two roots."""
    dx, dy, dz = (
        centres[one, 0] - centres[other, 0],
        centres[one, 1] - centres[other, 1],
        centres[one, 2] - centres[other, 2],
    )
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@inlined
def _insert(search: Any, count: Any, key: Any, one: Any, other: Any) -> Any:
    """Insert a candidate among those ordered by their keys, the least first."""
    keys, which = search.keys, search.which
    place = count
    while place > 0 and keys[place - 1] > key:
        keys[place] = keys[place - 1]
        which[place, 0], which[place, 1] = which[place - 1, 0], which[place - 1, 1]
        place -= 1
    keys[place], which[place, 0], which[place, 1] = key, one, other


@subroutine
def _solids_near(scene: Any, search: Any, margins: Any, most: Any) -> Any:
    """Fill the candidates of pieces and solids whose distance may not exceed the margin plus ``most``; count them."""
    count = 0
    for piece in range(scene.piece_body.size):
        body = scene.piece_body[piece]
        if body == 0:
            continue
        radius = scene.spheres[scene.piece_root[piece], 3]
        limit = radius + margins[body] + most
        for number in range(scene.solids.shape[0]):
            away = _root_from_solid(search.centres[piece], scene.solids[number])
            if away <= limit:
                _insert(search, count, away / radius, piece, number)
                count += 1
    return count


@subroutine
def _pieces_near(scene: Any, search: Any, pair_margins: Any, most: Any) -> Any:
    """Fill the candidates of pairs of pieces, as `_solids_near` does."""
    count = 0
    for pair in range(scene.pairs.shape[0]):
        one, other = scene.pairs[pair, 0], scene.pairs[pair, 1]
        radii = scene.spheres[scene.piece_root[one], 3] + scene.spheres[scene.piece_root[other], 3]
        away = _between(search.centres, one, other)
        if away <= radii + pair_margins[pair] + most:
            _insert(search, count, away / radii, pair, 0)
            count += 1
    return count


@subroutine
def _solid_gap(scene: Any, frames: Any, search: Any, number: Any, most: Any, stop: Any) -> Any:
    """Search a candidate of `_solids_near`."""
    spheres, children, triangles, trees = scene.spheres, scene.children, scene.triangles, search.trees
    piece, solid = search.which[number, 0], scene.solids[search.which[number, 1]]
    root = scene.piece_root[piece]
    into_solid(solid, frames[scene.piece_body[piece]], trees.pose)
    gap = piece_from_solid(spheres, children, triangles, root, solid, trees, most, stop)
    if gap > stop and solid_is_within(spheres, children, triangles, root, solid, trees):
        return -np.inf
    return gap


@subroutine
def _piece_gap(scene: Any, frames: Any, search: Any, number: Any, most: Any, stop: Any) -> Any:
    """Search a candidate of `_pieces_near`."""
    spheres, children, triangles, trees = scene.spheres, scene.children, scene.triangles, search.trees
    pair = search.which[number, 0]
    one, other = scene.pairs[pair, 0], scene.pairs[pair, 1]
    into_body(frames[scene.piece_body[one]], frames[scene.piece_body[other]], trees.pose)
    one, other = scene.piece_root[one], scene.piece_root[other]
    gap = piece_from_piece(spheres, children, triangles, one, other, trees, most, stop)
    if gap > stop and piece_is_within(spheres, children, triangles, one, other, trees):
        return -np.inf
    return gap


@subroutine
def verdict(scene: Any, frames: Any, margins: Any, pair_margins: Any, tells_near: Any, search: Any) -> Any:
    """Return `FREE` if all keep the clearance plus their margins, `NEAR` if only the clearance, else `BLOCKED`.

    Args:
        scene: the scene.
        frames: the placements of the bodies, shape (B, 12).
        margins: what each body keeps from every solid beside the clearance, m, shape (B,).
        pair_margins: what the two pieces of each pair keep from each other, m, shape (P,).
        tells_near: whether `NEAR` and `BLOCKED` are to be told apart; otherwise `NEAR` may mean either.
        search: from `make_search`.
    """
    _place_roots(scene, frames, search.centres)
    limit, share = scene.clearance + TOUCH, 1.0
    for number in range(_solids_near(scene, search, margins, limit)):
        margin = share * margins[scene.piece_body[search.which[number, 0]]]
        if _solid_gap(scene, frames, search, number, limit + margin, limit + margin) <= limit + margin:
            if not tells_near:
                return NEAR
            # From here on only contact matters.
            share = 0.0
            if margin <= 0.0 or _solid_gap(scene, frames, search, number, limit, limit) <= limit:
                return BLOCKED
    for number in range(_pieces_near(scene, search, pair_margins, limit)):
        margin = share * pair_margins[search.which[number, 0]]
        if _piece_gap(scene, frames, search, number, limit + margin, limit + margin) <= limit + margin:
            if not tells_near:
                return NEAR
            share = 0.0
            if margin <= 0.0 or _piece_gap(scene, frames, search, number, limit, limit) <= limit:
                return BLOCKED
    return FREE if share > 0.0 else NEAR


@subroutine
def is_free(scene: Any, frames: Any, margins: Any) -> Any:
    """Return whether every piece keeps more than the clearance plus its body's margin from everything.

    Two pieces keep the clearance plus the sum of both margins from each other.

    Args:
        scene: the scene.
        frames: the placements of the bodies, shape (B, 12).
        margins: m, shape (B,).
    """
    pair_margins = np.empty(scene.pairs.shape[0])
    for pair in range(pair_margins.size):
        one, other = scene.piece_body[scene.pairs[pair, 0]], scene.piece_body[scene.pairs[pair, 1]]
        pair_margins[pair] = margins[one] + margins[other]
    return verdict(scene, frames, margins, pair_margins, False, make_search(scene)) == FREE


@subroutine
def least_gap(scene: Any, frames: Any, most: Any, search: Any) -> Any:
    """Return a lower bound of the least distance between what is tested against each other, at most ``most``, m.

    It is 0 for contact, and else within 1e-6 m of the distance. The clearance plays no part.
    """
    _place_roots(scene, frames, search.centres)
    none = np.zeros(max(frames.shape[0], scene.pairs.shape[0]))
    for number in range(_solids_near(scene, search, none, most)):
        most = min(most, _solid_gap(scene, frames, search, number, most, TOUCH))
        if most <= TOUCH:
            return 0.0
    for number in range(_pieces_near(scene, search, none, most)):
        most = min(most, _piece_gap(scene, frames, search, number, most, TOUCH))
        if most <= TOUCH:
            return 0.0
    return most


@subroutine
def gap(scene: Any, frames: Any, most: Any) -> Any:
    """Return what `least_gap` does, with working arrays of its own."""
    return least_gap(scene, frames, most, make_search(scene))
