"""The proof that a robot touches nothing: pinocchio's kinematics and coal on the exact meshes.

It shares no code with planners but the decoder of meshes: it reads URDF and SRDF itself, and computes its own bounds of
motion. A robot's shapes are kept, so that a process that checks many solutions builds them once.

Which pairs are tested: every shape that moves against every obstacle, and against every shape of the robot that it
moves relative to. Exempt are links that the SRDF allows to touch, the parent and the child of a joint, and attached
things with what they may touch. Two shapes that never move relative to each other are not tested.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from problems.digests import digest
from problems.robots.proof_pairs import Pairs
from problems.robots.proof_robot import Robot
from problems.robots.proof_shapes import Floats, shape_of_table

Table = Mapping[str, Any]
Configuration = Sequence[float] | Floats
Made = TypeVar("Made")

STEP = 1e-3
"""Motions are tested at configurations between which no two points approach each other by more than this, m, unless a
larger measured distance allows more."""
ROUNDING = 1e-5
"""The most that a joint may be beyond its limits, rad or m: many URDFs state π as 3.14159."""

_ACCURACY = 1e-3  # m: the least gap of a path is reported to this, or to this share of it if that is more
_SHARE = 0.02
_FEW_HALVINGS = 8.0  # the most parts into which a stretch is divided rather than to measure an exact distance
_KEPT = 8  # robots, and scenes, that a process keeps


@dataclass(frozen=True)
class Contact:
    """Two shapes that touch, or come nearer than they may.

    Attributes:
        one: the name of the first: a link, an attached thing, or an obstacle.
        other: the name of the second.
        depth: how deep they overlap, m; 0 if they do not.
        distance: how far they are apart, m; 0 if they touch.
    """

    one: str
    other: str
    depth: float
    distance: float = 0.0

    def in_words(self, clearance: float = 0.0) -> str:
        """Return the contact in words, as the rest of a sentence that says where."""
        if self.distance > 0.0:
            return f"{self.one} comes within {1e3 * self.distance:.3g} mm of {self.other}, less than the clearance " + (
                f"{clearance:g} m"
            )
        return f"{self.one} touches {self.other}" + (f", {1e3 * self.depth:.3g} mm deep" if self.depth > 0.0 else "")


@dataclass(frozen=True)
class PathProof:
    """The findings about a path.

    Attributes:
        least: the least distance between two things that must not touch, m; to 1 mm or 2 %, whichever is more, and 0 if
            something touches; +inf if there is nothing to touch.
        where: the configuration with that distance, the number of its segment, from 1, and the two names.
        length: the sum of the Euclidean lengths of the segments, rad (m of sliding joints count as rad).
        objections: why the path is not acceptable, in words.
        tests: the number of configurations that were tested.
    """

    least: float
    where: dict[str, Any]
    length: float
    objections: tuple[str, ...]
    tests: int


class Proof:
    """A robot among obstacles, with attached things.

    Args:
        robot: the gathered fields of ``[robot]``, as plain values.
        obstacles: the tables ``[[obstacles]]``, as plain values.
        attached: the tables ``[[attached]]``, as plain values.
        self_collision: whether the robot must not touch itself.

    Raises:
        BadInput: if pinocchio or coal is not installed, or the fields do not fit each other.
    """

    def __init__(
        self,
        robot: Table,
        obstacles: Sequence[Table] = (),
        attached: Sequence[Table] = (),
        self_collision: bool = True,
    ) -> None:
        self.robot = _kept(_robots, [robot], lambda: Robot(robot))
        meshes = dict(robot.get("meshes") or {})
        solids = [
            shape_of_table(str(table.get("id") or f"obstacles[{number}]"), table, meshes)
            for number, table in enumerate(obstacles)
        ]
        things = [
            (shape_of_table(str(table.get("id") or f"attached[{number}]"), table, meshes), table)
            for number, table in enumerate(attached)
        ]
        self._solids, self._things = solids, things
        self._pairs = Pairs(self.robot, solids, things, self_collision)

    @staticmethod
    def of(
        robot: Table,
        obstacles: Sequence[Table] = (),
        attached: Sequence[Table] = (),
        self_collision: bool = True,
    ) -> Proof:
        """Return the proof of these fields, from those that this process has made before if it is among them."""
        fields = robot, obstacles, attached, self_collision
        return _kept(_proofs, fields, lambda: Proof(*fields))

    @property
    def joints(self) -> tuple[str, ...]:
        """The names of the joints that move, in the order of configurations."""
        return self.robot.joints

    @property
    def limits(self) -> Floats:
        """The lowest and the highest value of each joint, rad or m, shape (n, 2)."""
        return self.robot.limits

    @property
    def turning(self) -> NDArray[np.bool_]:
        """Whether each joint turns; the others slide. Shape (n,)."""
        return self.robot.turning

    def pose(self, configuration: Configuration, link: str) -> Floats:
        """Return the frame of a link in the world, a 4×4 matrix.

        Raises:
            BadInput: if there is no such link.
        """
        return self.robot.pose(configuration, link)

    def beyond_limits(self, configuration: Configuration) -> Iterator[str]:
        """Yield a sentence for each joint that is beyond its limits."""
        for name, value, (low, high) in zip(self.joints, configuration, self.limits, strict=True):
            if not low - ROUNDING <= value <= high + ROUNDING:
                yield f"joint {name} is at {value:.6g}, outside its limits [{low:g}, {high:g}]"

    def gap(self, configuration: Configuration) -> tuple[float, tuple[str, str] | None]:
        """Return the least distance of two things that must not touch, m, and their names; 0 if something touches.

        Returns:
            +inf and None if there is nothing to touch.
        """
        pairs = self._pairs
        pairs.place(configuration)
        least, pair = pairs.least(np.inf)
        return max(0.0, least), None if pair is None else pairs.names(pair)

    def contacts(self, configuration: Configuration, clearance: float = 0.0) -> list[Contact]:
        """Return the pairs that touch, or are nearer to each other than the clearance, m; the deepest first.

        Of two links with several shapes each, the worst pair of shapes is returned.
        """
        return self._nearer(self._pairs, configuration, clearance)

    def standing_contacts(self, clearance: float = 0.0) -> list[Contact]:
        """Return the contacts, as `contacts` does, of parts behind held joints with obstacles: no path changes them."""
        return self._nearer(self._standing, np.zeros(len(self.joints)), clearance)

    @cached_property
    def _standing(self) -> Pairs:
        """The pairs that no path changes; needed where a problem is read, and not where its paths are proven."""
        return Pairs(self.robot, self._solids, self._things, standing=True)

    def _nearer(self, pairs: Pairs, configuration: Configuration, clearance: float) -> list[Contact]:
        pairs.place(configuration)
        found = []
        for pair in np.flatnonzero(pairs.bounds() <= clearance).tolist():
            distance = pairs.distance(pair, clearance)
            if distance <= 0.0:
                found.append(Contact(*pairs.names(pair), pairs.depth(pair)))
            elif distance < clearance:
                found.append(Contact(*pairs.names(pair), 0.0, distance))
        worst: dict[tuple[str, str], Contact] = {}
        for contact in sorted(found, key=lambda contact: (contact.distance, -contact.depth)):
            worst.setdefault((contact.one, contact.other), contact)
        return list(worst.values())

    def of_path(self, path: Sequence[Configuration] | Floats, clearance: float = 0.0) -> PathProof:
        """Prove that the straight segments between configurations keep the clearance, m, or say where they do not.

        Of a path that leaves the limits only the configurations are tested.

        Args:
            path: at least one configuration, rad or m.
            clearance: the least distance that must be kept, m.
        """
        points = np.asarray(path, float)
        objections = [f"point {at}: {text}" for at, each in enumerate(points, 1) for text in self.beyond_limits(each)]
        walk = _Walk(self._pairs, points, clearance)
        walk.at_points()
        if not objections:  # beyond the limits a segment may have any length, and halving it would never end
            walk.between()
        for pair, (segment, share, distance) in sorted(walk.hits.items(), key=lambda hit: hit[1]):
            objections.append(self._in_words(points, segment, share, pair, distance, clearance))
        length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
        return PathProof(max(0.0, walk.least), walk.where(), length, tuple(objections), walk.tests)

    def _in_words(
        self, points: Floats, segment: int, share: float, pair: int, distance: float, clearance: float
    ) -> str:
        pairs = self._pairs
        pairs.place(_between(points, segment, share))
        depth = pairs.depth(pair) if distance <= 0.0 else 0.0
        contact = Contact(*pairs.names(pair), depth, max(0.0, distance))
        last = len(points) - 1
        place = {(0, 0.0): "at the start", (last, 0.0): "at the goal"}.get((segment, share))
        if place is None:
            place = f"at point {segment + 1}" if share == 0.0 else f"on segment {segment + 1}, after {share:.1%} of it"
        return f"{place}: {contact.in_words(clearance)}"


class _Walk:
    """The search for contacts and for the least distance along a path.

    A stretch of the path is tested in its middle. A pair that is farther apart there than it can approach on half of
    the stretch is done with; for the others both halves are looked at, level by level, so that the least distance is
    known roughly before the path is looked at closely.
    """

    def __init__(self, pairs: Pairs, points: Floats, clearance: float) -> None:
        self._pairs, self._points, self._clearance = pairs, points, clearance
        self.hits: dict[int, tuple[int, float, float]] = {}  # of each pair the first contact found: segment, share, m
        self.least, self._place, self._nearest = np.inf, (0, 0.0), -1
        self.tests = 0

    def where(self) -> dict[str, Any]:
        """Return where the least distance is, as plain values."""
        if self._nearest < 0:
            return {}
        configuration = _between(self._points, *self._place)
        return {
            "configuration": configuration.tolist(),
            "segment": min(self._place[0] + 1, max(1, len(self._points) - 1)),
            "between": list(self._pairs.names(self._nearest)),
        }

    def at_points(self) -> None:
        """Test the configurations that the path names."""
        pairs = self._pairs
        for number, point in enumerate(self._points):
            pairs.place(point)
            self.tests += 1
            least, pair = pairs.least(max(self.least, self._clearance))
            if pair is not None and least < self.least:
                self._lower(least, pair, number, 0.0)
            if least < self._clearance or least <= 0.0:
                for near in np.flatnonzero(pairs.bounds() <= self._clearance).tolist():
                    self._judge(near, pairs.distance(near, self._clearance), number, 0.0)

    def between(self) -> None:
        """Test the segments."""
        left: deque[tuple[int, float, float, NDArray[np.int64]]] = deque()
        motions = [
            self._pairs.motion(after - before) for before, after in zip(self._points, self._points[1:], strict=False)
        ]
        for segment, motion in enumerate(motions):
            moving = np.flatnonzero(motion > 0.0)
            if moving.size:
                left.append((segment, 0.0, 1.0, moving))
        while left:
            segment, begin, end, alive = left.popleft()
            middle = (begin + end) / 2.0
            half = motions[segment] * ((end - begin) / 2.0)
            alive = self._not_done(segment, middle, alive, half)
            if alive.size:
                left.append((segment, begin, middle, alive))
                left.append((segment, middle, end, alive))

    def _not_done(self, segment: int, share: float, alive: NDArray[np.int64], half: Floats) -> NDArray[np.int64]:
        """Test the middle of a stretch; return the pairs for which its halves must be looked at."""
        pairs = self._pairs
        pairs.place(_between(self._points, segment, share))
        self.tests += 1
        near = alive[pairs.bounds(alive) - half[alive] <= self._enough()]
        kept = []
        for pair in near.tolist():
            enough = half[pair] + self._enough()
            distance = pairs.lower_bound(pair)
            if distance > enough:
                continue
            if distance > self._enough() + half[pair] / _FEW_HALVINGS:
                kept.append(pair)  # hulls alone will do after some halvings; exact distances cost far more
                continue
            distance = pairs.distance(pair, enough)
            if distance > enough:
                continue
            if distance < self.least:
                self._lower(distance, pair, segment, share)
            if not self._judge(pair, distance, segment, share) and (
                half[pair] > STEP / 2.0 and distance - half[pair] <= self._enough()
            ):
                kept.append(pair)
        return np.array(kept, np.int64)

    def _enough(self) -> float:
        """Return the distance beyond which a pair is of no interest, m."""
        return max(self._clearance, self.least - max(_ACCURACY, _SHARE * self.least)) if self.least < np.inf else np.inf

    def _lower(self, distance: float, pair: int, segment: int, share: float) -> None:
        self.least, self._nearest, self._place = distance, pair, (segment, share)

    def _judge(self, pair: int, distance: float, segment: int, share: float) -> bool:
        """Return whether a pair is too near, and remember the first such place that is found."""
        if distance > 0.0 and distance >= self._clearance:
            return False
        self.hits.setdefault(pair, (segment, share, distance))
        return True


def _between(points: Floats, segment: int, share: float) -> Floats:
    point: Floats = points[segment]
    return point if share == 0.0 else point + share * (points[segment + 1] - point)


_robots: OrderedDict[str, Robot] = OrderedDict()
_proofs: OrderedDict[str, Proof] = OrderedDict()


def _kept(kept: OrderedDict[str, Made], fields: Any, make: Callable[[], Made]) -> Made:
    """Return what was made of these fields before, or make it; the oldest of too many is forgotten."""
    key = digest(fields)
    if key not in kept:
        kept[key] = make()
        while len(kept) > _KEPT:
            kept.popitem(last=False)
    kept.move_to_end(key)
    return kept[key]
