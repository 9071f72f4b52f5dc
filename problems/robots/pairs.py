"""Which links need no collision check against each other: found by sampling where no SRDF says so.

As MoveIt's setup assistant does: links across one joint, links that touch in (nearly) every configuration, and links
that touch in none of many random ones. Spheres decide "never", which they can only call too seldom; triangles decide
"always".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lowlevel.compiled import kernel, subroutine
from problems.robots.chain import Chain
from problems.robots.srdf import Pair, pair_of
from problems.robots.urdf import Urdf

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

SAMPLES = 3000
_FIRST = 200  # samples after which only pairs that have never touched go on
_MARGIN = 0.01  # m, by which spheres must stay apart in every sample for "never"
_ALWAYS = 0.95  # share of samples
_EXACT = 60  # samples in which triangles are tested
_SEED = 1
_DEEPEST = 512  # pairs of spheres that wait on the stack


def adjacent(urdf: Urdf) -> set[Pair]:
    """Return the pairs of links that one joint joins."""
    return {pair_of(joint.parent, joint.child) for joint in urdf.joints.values()}


def disabled_by_sampling(
    urdf: Urdf, chain: Chain, names: tuple[str, ...], bodies: Integers, trees: Trees
) -> dict[Pair, str]:
    """Return the pairs of links that need no check, with the reason: Adjacent, Always or Never.

    Args:
        urdf: the robot.
        chain: its bodies.
        names: the link of each piece.
        bodies: the body of each piece.
        trees: the pieces.
    """
    beside = adjacent(urdf)
    pairs = [(i, j) for i in range(len(names)) for j in range(i + 1, len(names)) if bodies[i] != bodies[j]]
    disabled = {pair_of(names[i], names[j]): "Adjacent" for i, j in pairs if pair_of(names[i], names[j]) in beside}
    asked = np.array([pair for pair in pairs if pair_of(*(names[each] for each in pair)) not in beside], np.int64)
    asked = asked.reshape(-1, 2)
    if not len(asked):
        return disabled
    frames = chain.frames(chain.random(SAMPLES, _SEED))
    touched = trees.touched(asked, bodies, frames[:_FIRST], _MARGIN)
    never = touched == 0
    never[never] = trees.touched(asked[never], bodies, frames[_FIRST:], _MARGIN) == 0
    always = trees.always_touching(asked, bodies, frames[:_FIRST])
    for (i, j), is_never, is_always in zip(asked, never, always, strict=True):
        if is_never or is_always:
            disabled[pair_of(names[i], names[j])] = "Never" if is_never else "Always"
    return disabled


class Trees:
    """Pieces with their sphere trees, tested against each other at many configurations.

    Attributes:
        roots: the root of each piece's tree, shape (L,).
        spheres: see `Arm`.
        children: see `Arm`.
        triangles: see `Arm`.
    """

    def __init__(self, roots: Integers, spheres: Floats, children: Integers, triangles: Floats) -> None:
        self.roots, self.spheres, self.children, self.triangles = roots, spheres, children, triangles

    def touched(self, pairs: Integers, bodies: Integers, frames: Floats, margin: float) -> Integers:
        """Return at how many configurations the leaves' spheres of each pair come within a margin, shape (P,)."""
        counts = np.zeros(len(pairs), np.int64)
        if len(pairs):
            count_touches(self.spheres, self.children, self.roots, bodies, pairs, frames, margin, counts)
        return counts

    def always_touching(self, pairs: Integers, bodies: Integers, frames: Floats) -> NDArray[np.bool_]:
        """Return whether the triangles of each pair touch at nearly every configuration, shape (P,)."""
        always = self.touched(pairs, bodies, frames, 0.0) >= _ALWAYS * len(frames)
        few = frames[:_EXACT]
        for number in np.flatnonzero(always):
            one, other = pairs[number]
            count = self._touches(int(one), int(other), bodies, few)
            always[number] = count >= _ALWAYS * len(few)
        return always

    def _touches(self, one: int, other: int, bodies: Integers, frames: Floats) -> int:
        """Return at how many configurations the triangles of two pieces touch."""
        import fcl

        first, second = (self._body(piece) for piece in (one, other))
        count = 0
        for own in frames:
            for piece, thing in ((one, first), (other, second)):
                matrix = own[bodies[piece]].reshape(3, 4)
                thing.setTransform(fcl.Transform(matrix[:, :3], matrix[:, 3]))
            count += bool(fcl.collide(first, second, fcl.CollisionRequest(), fcl.CollisionResult()))
        return count

    def _body(self, piece: int) -> Any:
        import fcl

        soup = self.triangles_of(piece)
        model = fcl.BVHModel()
        model.beginModel(len(soup), 3 * len(soup))
        model.addSubModel(soup.reshape(-1, 3), np.arange(3 * len(soup)).reshape(-1, 3))
        model.endModel()
        return fcl.CollisionObject(model)

    def triangles_of(self, piece: int) -> Floats:
        """Return the triangles of a piece, shape (T, 9)."""
        found, left = [np.empty((0, 9))], [int(self.roots[piece])]
        while left:
            first, count = self.children[left.pop()]
            if first < 0:
                found.append(self.triangles[-first - 1 : -first - 1 + count])
            else:
                left += range(int(first), int(first + count))
        return np.concatenate(found)


@subroutine
def _moved(frame: Any, sphere: Any, centre: Any) -> None:
    for axis in range(3):
        row = 4 * axis
        centre[axis] = frame[row] * sphere[0] + frame[row + 1] * sphere[1] + frame[row + 2] * sphere[2] + frame[row + 3]


@subroutine
def _leaves_touch(
    spheres: Any, children: Any, first: Any, second: Any, one: Any, other: Any, margin: Any, stack: Any, room: Any
) -> Any:
    """Return whether spheres of leaves of two trees come within a margin of each other."""
    stack[0, 0], stack[0, 1] = first, second
    size = 1
    while size > 0:
        size -= 1
        a, b = stack[size, 0], stack[size, 1]
        _moved(one, spheres[a], room[0])
        _moved(other, spheres[b], room[1])
        squared = 0.0
        for axis in range(3):
            squared += (room[0, axis] - room[1, axis]) ** 2
        if squared > (spheres[a, 3] + spheres[b, 3] + margin) ** 2:
            continue
        if children[a, 0] < 0 and children[b, 0] < 0:
            return True
        if size + 2 > stack.shape[0]:
            return True  # no room to look closer: called a touch, which is on the safe side
        # The larger sphere is replaced by its children.
        if children[b, 0] < 0 or (children[a, 0] >= 0 and spheres[a, 3] > spheres[b, 3]):
            for child in range(children[a, 0], children[a, 0] + children[a, 1]):
                stack[size, 0], stack[size, 1] = child, b
                size += 1
        else:
            for child in range(children[b, 0], children[b, 0] + children[b, 1]):
                stack[size, 0], stack[size, 1] = a, child
                size += 1
    return False


@kernel(
    "void(float64[:,::1], int64[:,::1], int64[::1], int64[::1], int64[:,::1], float64[:,:,::1], float64, int64[::1])",
    may_be_long=True,
)
def count_touches(
    spheres: Floats,
    children: Integers,
    roots: Integers,
    bodies: Integers,
    pairs: Integers,
    frames: Floats,
    margin: float,
    counts: Integers,
) -> None:
    """Add to ``counts`` (P,) at how many of the frames (N, B, 12) leaves of each pair come within a margin, m."""
    stack, room = np.empty((_DEEPEST, 2), np.int64), np.empty((2, 3))
    for sample in range(frames.shape[0]):
        for number in range(pairs.shape[0]):
            one, other = pairs[number, 0], pairs[number, 1]
            counts[number] += _leaves_touch(
                spheres,
                children,
                roots[one],
                roots[other],
                frames[sample, bodies[one]],
                frames[sample, bodies[other]],
                margin,
                stack,
                room,
            )
