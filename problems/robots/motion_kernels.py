"""The compiled proof that a straight segment in configuration space is free of contact.

The middle of an interval is tested with each body inflated by the most that any of its points moves over half of the
interval. If that is free, so is the whole interval. If only the middle itself is free, both halves follow. All
intervals of a level are tested before those of the next one, so that a contact anywhere shows after few tests.
"""

from typing import Any, NamedTuple

import numpy as np

from lowlevel.compiled import subroutine
from problems.robots.collision_kernels import BLOCKED, FREE, make_search, verdict
from problems.robots.kinematics_kernels import place

FINEST = 2e-4
"""An interval within whose half no point moves farther than this, m, counts as blocked if it is not proven free."""
_BREADTH = 1024  # intervals that wait for their level; beyond this number the search goes into depth
_PENDING = _BREADTH + 256


class Room(NamedTuple):
    """The working arrays of `is_way_free`."""

    q: Any  # (n,): the configuration that is tested
    frames: Any  # (B, 12): its placements
    moves: Any  # (B,): the most that a point of each body moves over the whole segment, m
    pair_moves: Any  # (P,): the same for two pieces in relation to each other
    margins: Any  # (B,)
    pair_margins: Any  # (P,)
    rigid: Any  # (P, n): whether a variable moves both pieces of a pair as one, or neither
    pending: Any  # (_PENDING, 2): the middles of intervals still to be tested, and halves of their lengths
    search: Any  # the working arrays of `verdict`
    tests: Any  # (1,) int64: configurations tested so far


@subroutine
def _carries(scene: Any, joint: Any, body: Any) -> Any:
    """Return whether a joint's body is another body, or carries it."""
    while body > joint:
        body = scene.parents[body]
    return body == joint


@subroutine
def make_room(scene: Any) -> Any:
    """Return working arrays for `is_way_free`."""
    bodies, pairs, variables = scene.kinds.size, scene.pairs.shape[0], scene.limits.shape[0]
    rigid = np.ones((pairs, variables), np.bool_)
    for pair in range(pairs):
        one, other = scene.piece_body[scene.pairs[pair, 0]], scene.piece_body[scene.pairs[pair, 1]]
        for joint in range(1, bodies):
            if _carries(scene, joint, one) != _carries(scene, joint, other):
                rigid[pair, scene.variables[joint]] = False
    return Room(
        np.empty(variables),
        np.empty((bodies, 12)),
        np.empty(bodies),
        np.empty(pairs),
        np.empty(bodies),
        np.empty(pairs),
        rigid,
        np.empty((_PENDING, 2)),
        make_search(scene),
        np.zeros(1, np.int64),
    )


@subroutine
def _measure(scene: Any, a: Any, b: Any, room: Any) -> Any:
    """Fill how far bodies and pairs move over a segment at most; return the greatest of these, m."""
    greatest = 0.0
    for body in range(scene.kinds.size):
        room.moves[body] = 0.0
        for variable in range(a.size):
            room.moves[body] += scene.reach[body, variable] * abs(b[variable] - a[variable])
        greatest = max(greatest, room.moves[body])
    for pair in range(scene.pairs.shape[0]):
        one, other = scene.piece_body[scene.pairs[pair, 0]], scene.piece_body[scene.pairs[pair, 1]]
        room.pair_moves[pair] = 0.0
        for variable in range(a.size):
            if not room.rigid[pair, variable]:
                reach = scene.reach[one, variable] + scene.reach[other, variable]
                room.pair_moves[pair] += reach * abs(b[variable] - a[variable])
        greatest = max(greatest, room.pair_moves[pair])
    return greatest


@subroutine
def _test(scene: Any, a: Any, b: Any, turned: Any, middle: Any, half: Any, room: Any) -> Any:
    """Return the verdict about an interval's middle, inflated by what moves over ``half`` of the segment's length."""
    for variable in range(a.size):
        step = b[variable] - a[variable]
        room.q[variable] = b[variable] - middle * step if turned else a[variable] + middle * step
    room.tests[0] += 1
    place(scene, room.q, room.frames)
    for body in range(room.margins.size):
        room.margins[body] = half * room.moves[body]
    for pair in range(room.pair_margins.size):
        room.pair_margins[pair] = half * room.pair_moves[pair]
    return verdict(scene, room.frames, room.margins, room.pair_margins, True, room.search)


@subroutine
def is_configuration_free(scene: Any, q: Any, room: Any) -> Any:
    """Return whether a configuration keeps the clearance."""
    place(scene, q, room.frames)
    room.margins[:] = 0.0
    room.pair_margins[:] = 0.0
    return verdict(scene, room.frames, room.margins, room.pair_margins, False, room.search) == FREE


@subroutine
def is_way_free(scene: Any, a: Any, b: Any, room: Any) -> Any:
    """Return whether the straight segment from a to b, ends included, keeps the clearance everywhere.

    The answer is the same for both directions.

    Args:
        scene: the scene.
        a: a configuration, shape (n,).
        b: another one.
        room: from `make_room`.
    """
    # Rounding could make the two directions differ: the end that is less in the first joint that moves is the first.
    turned = False
    for variable in range(a.size):
        if a[variable] != b[variable]:
            turned = a[variable] > b[variable]
            break
    finest = FINEST / max(_measure(scene, a, b, room), FINEST)
    pending, first, count = room.pending, 0, 1
    pending[0, 0], pending[0, 1] = 0.5, 0.5
    while count > 0:
        middle, half = pending[first, 0], pending[first, 1]
        first, count = (first + 1) % _PENDING, count - 1
        answer = _test(scene, a, b, turned, middle, half, room)
        if answer == BLOCKED:
            return False
        if answer == FREE:
            continue
        half *= 0.5
        if half < finest:
            return False
        if count < _BREADTH:
            last = (first + count) % _PENDING
            pending[last, 0], pending[last, 1] = middle - half, half
            last = (last + 1) % _PENDING
            pending[last, 0], pending[last, 1] = middle + half, half
        else:
            first = (first - 2 + _PENDING) % _PENDING
            pending[first, 0], pending[first, 1] = middle - half, half
            last = (first + 1) % _PENDING
            pending[last, 0], pending[last, 1] = middle + half, half
        count += 2
    return True
