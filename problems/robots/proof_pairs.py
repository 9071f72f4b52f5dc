"""The pairs of shapes that the proof tests: where they are, how far apart, and how quickly they may approach."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems.robots.proof_robot import Robot
from problems.robots.proof_shapes import GJK_ERROR, Floats, Shape

Table = Mapping[str, Any]

_CONTACTS = 64  # of a pair, among which the deepest is looked for


@dataclass(frozen=True, eq=False)
class _Piece:
    """A shape with the pinocchio joint that carries it, and its place in that joint's frame, a 4×4 matrix."""

    shape: Shape
    joint: int
    placement: Floats
    link: str | None = None  # of the robot's own shapes
    free_of: frozenset[str] | None = None  # of attached things: what they may touch


class Pairs:
    """All pairs of shapes that must not touch, at one configuration at a time; see `place`.

    Args:
        robot: the robot.
        solids: the obstacles.
        things: the attached things with their tables.
        self_collision: whether the robot's links are tested against each other.
        standing: True for the pairs that no joint of a configuration moves instead, see `_stands_by`.
    """

    def __init__(
        self,
        robot: Robot,
        solids: Sequence[Shape],
        things: Sequence[tuple[Shape, Table]],
        self_collision: bool = True,
        *,
        standing: bool = False,
    ) -> None:
        self._robot, self._self_collision = robot, self_collision
        self._pieces = [*self._own(), *self._attached(things), *(_Piece(each, 0, each.placement) for each in solids)]
        is_wanted = self._stands_by if standing else self._is_tested
        pairs = [pair for pair in combinations(range(len(self._pieces)), 2) if is_wanted(*pair)]
        self._pairs: NDArray[np.int64] = np.array(pairs, np.int64).reshape(-1, 2)
        shapes = [piece.shape for piece in self._pieces]
        radii = np.array([shape.radius for shape in shapes])
        self._radii = radii[self._pairs].sum(axis=1)
        self._joints = np.array([piece.joint for piece in self._pieces], np.int64)
        centres = [(piece.placement @ [*piece.shape.centre, 1.0]) for piece in self._pieces]
        self._centres = np.array(centres).reshape(-1, 4)
        self._approach = self._approaches()
        self._hulls, self._exact = self._scene(hulls=True), self._scene(hulls=False)
        self._has_hulls = [not (shapes[one].is_convex and shapes[other].is_convex) for one, other in self._pairs]

    # What is tested ---------------------------------------------------------------------------------------------------
    def _own(self) -> Iterator[_Piece]:
        for link, shape in zip(self._robot.link_of, self._robot.shapes, strict=True):
            joint, frame = self._robot.attachment(link)
            yield _Piece(shape, joint, frame @ shape.placement, link)

    def _attached(self, things: Sequence[tuple[Shape, Table]]) -> Iterator[_Piece]:
        for shape, table in things:
            joint, frame = self._robot.attachment(table["link"])
            yield _Piece(shape, joint, frame @ shape.placement, None, frozenset(table.get("may_touch") or ()))

    def _is_tested(self, one: int, other: int) -> bool:
        first, second = self._pieces[one], self._pieces[other]
        if self._robot.body(first.joint) == self._robot.body(second.joint):
            return False
        if first.link is not None and second.link is not None:
            return self._self_collision and frozenset((first.link, second.link)) not in self._robot.may_touch
        for thing, else_ in ((first, second), (second, first)):
            # A solid obstacle is never exempt: `may_touch` names links and meshes.
            may_be_exempt = else_.link is not None or else_.shape.is_mesh
            if thing.free_of is not None and may_be_exempt and else_.shape.name in thing.free_of:
                return False
        return True

    def _stands_by(self, one: int, other: int) -> bool:
        """Return whether these are a part of the robot behind a joint that is held, and an obstacle.

        Links that the URDF itself joins to the root by fixed joints only are exempt: a base stands on its floor.
        """
        first, second = self._pieces[one], self._pieces[other]  # obstacles come last
        is_obstacle = second.link is None and second.free_of is None
        is_held = first.joint != 0 and self._robot.body(first.joint) == 0
        return is_obstacle and is_held and not (second.shape.is_mesh and second.shape.name in (first.free_of or ()))

    def names(self, pair: int) -> tuple[str, str]:
        """Return the names of the two shapes of a pair."""
        one, other = self._pairs[pair]
        return self._pieces[one].shape.name, self._pieces[other].shape.name

    # Motion -----------------------------------------------------------------------------------------------------------
    def _approaches(self) -> Floats:
        """Return how much nearer each pair may come when a variable changes by 1, m per rad or m, shape (pairs, n).

        Joints that move both shapes do not change their distance.
        """
        approach = np.zeros((len(self._pairs), len(self._robot.joints)))
        reaches = []
        for piece in self._pieces:
            corners = piece.shape.corners @ piece.placement[:3, :3].T + piece.placement[:3, 3]
            reaches.append(self._robot.reach(piece.joint, corners, piece.shape.rounding))
        for row, (one, other) in enumerate(self._pairs.tolist()):
            movers = [self._robot.movers(self._pieces[each].joint) for each in (one, other)]
            for piece, own, others in ((one, *movers), (other, *reversed(movers))):
                for joint in own:
                    if joint not in others:
                        variable, multiplier = self._robot.variable(joint)
                        approach[row, variable] += multiplier * reaches[piece][joint]
        return approach

    def motion(self, difference: Floats) -> Floats:
        """Return the most by which each pair may approach on a straight segment, m, shape (pairs,).

        Args:
            difference: the segment's end minus its beginning, rad or m, shape (n,).
        """
        motion: Floats = self._approach @ np.abs(difference)
        return motion

    # Distances --------------------------------------------------------------------------------------------------------
    def place(self, configuration: Any) -> None:
        """Place all shapes; what follows is at this configuration."""
        frames = self._robot.place(configuration)
        self._places = np.einsum("pij,pj->pi", frames[self._joints], self._centres)[:, :3]
        self._hulls.is_placed = self._exact.is_placed = False

    def bounds(self, pairs: NDArray[np.int64] | None = None) -> Floats:
        """Return a lower bound of the distance of each pair, or of some, by bounding spheres, m."""
        chosen, radii = (self._pairs, self._radii) if pairs is None else (self._pairs[pairs], self._radii[pairs])
        apart = self._places[chosen[:, 0]] - self._places[chosen[:, 1]]
        bounds: Floats = np.sqrt(np.einsum("ij,ij->i", apart, apart)) - radii
        return bounds

    def lower_bound(self, pair: int) -> float:
        """Return a lower bound of the distance of a pair, m: that of the convex hulls; 0 or less if these touch."""
        return self._hulls.distance(pair) - GJK_ERROR

    def distance(self, pair: int, enough: float) -> float:
        """Return the distance of a pair, m, 0 or less if it touches; a lower bound will do if it exceeds ``enough``."""
        between_hulls = self.lower_bound(pair)
        if not self._has_hulls[pair] or between_hulls > enough:
            return between_hulls
        distance = self._exact.distance(pair) - GJK_ERROR
        if distance > 0.0 and between_hulls <= 0.0 and self._is_within(pair):
            return 0.0
        return distance

    def least(self, limit: float) -> tuple[float, int | None]:
        """Return the least distance of all pairs, m, and the pair; ``limit`` and None if none is nearer than that."""
        bounds = self.bounds()
        best, nearest = limit, None
        for pair in np.argsort(bounds, kind="stable").tolist():
            if bounds[pair] >= best:
                break
            distance = self.distance(pair, best)
            if distance < best:
                best, nearest = distance, pair
        return best, nearest

    def depth(self, pair: int) -> float:
        """Return how deep a pair overlaps, m, as the deepest contact that coal finds."""
        return self._exact.depth(pair)

    def _is_within(self, pair: int) -> bool:
        """Return whether one shape is wholly inside the closed surface of the other, which it does not touch."""
        one, other = (self._pieces[each] for each in self._pairs[pair])
        for inner, outer in ((one, other), (other, one)):
            point = self._exact.place_of(outer, inner.shape.corners[0], inner)
            if outer.shape.contains(point):
                return True
        return False

    def _scene(self, hulls: bool) -> _Scene:
        return _Scene(self._robot, self._pieces, self._pairs, hulls)


class _Scene:
    """The shapes of all pieces, or their hulls, as pinocchio keeps geometry."""

    def __init__(self, robot: Robot, pieces: Sequence[_Piece], pairs: NDArray[np.int64], hulls: bool) -> None:
        self._pinocchio, self._model, self._data = robot.geometry()
        self._geometry = self._pinocchio.GeometryModel()
        self._numbers = {}
        for number, piece in enumerate(pieces):
            solid = piece.shape.hull if hulls else piece.shape.exact
            name = f"{number} {piece.shape.name}"  # pinocchio wants different names
            placed = self._pinocchio.GeometryObject(name, piece.joint, self._pinocchio.SE3(piece.placement), solid)
            self._geometry.addGeometryObject(placed)
            self._numbers[id(piece)] = number
        for one, other in pairs.tolist():
            self._geometry.addCollisionPair(self._pinocchio.CollisionPair(one, other))
        self._placed = self._pinocchio.GeometryData(self._geometry)
        for request in self._placed.distanceRequests:
            request.enable_signed_distance = False
        for request in self._placed.collisionRequests:
            request.enable_contact = True
            request.num_max_contacts = _CONTACTS
        self.is_placed = False

    def _place(self) -> None:
        if not self.is_placed:
            self._pinocchio.updateGeometryPlacements(self._model, self._data, self._geometry, self._placed)
            self.is_placed = True

    def distance(self, pair: int) -> float:
        """Return the distance of a pair, m; 0 or less if it touches."""
        self._place()
        return float(self._pinocchio.computeDistance(self._geometry, self._placed, pair).min_distance)

    def depth(self, pair: int) -> float:
        """Return the depth of the deepest contact of a pair, m; 0 if there is none."""
        self._place()
        if not self._pinocchio.computeCollision(self._geometry, self._placed, pair):
            return 0.0
        contacts = self._placed.collisionResults[pair].getContacts()
        return max((abs(float(each.penetration_depth)) for each in contacts), default=0.0)

    def place_of(self, outer: _Piece, point: Floats, inner: _Piece) -> Floats:
        """Return a point of the inner piece, given in its own frame, in the own frame of the outer piece."""
        self._place()
        frames = [self._placed.oMg[self._numbers[id(each)]] for each in (outer, inner)]
        place: Floats = frames[0].actInv(frames[1].act(point))
        return place
