"""Find a way of a polygon by turns in place and straight drives, where the disc that encloses it does not get through.

Places where the enclosing disc is free are *roomy*: the robot turns freely there, and within one connected part of them
it gets from anywhere to anywhere. Outside of them a wave of poses spreads: at each place the robot turns both ways as
far as it can, and at each heading it drives as far as it can. The wave from the start goes forwards, the one from the
goal backwards, those from narrow gaps between two obstacles both ways, until they come to roomy parts. The shortest
ways within the roomy parts connect them.

The search is sound but not complete. Each turn and drive is free for certain: a drive is a line that crosses no place
forbidden at its heading, and a turn is tested with the robot swept from heading to heading. But poses lie on a raster
and headings on a list, so an existing way may be missed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from problems.mobile_robot.oracle_shapes import (
    ARC,
    AROUND,
    Floats,
    Points,
    convex,
    forbidden,
    parts,
    room_for,
    shorter,
    swept,
)
from problems.mobile_robot.oracle_ways import shortest_way
from problems.plane import Circle

if TYPE_CHECKING:
    from problems.mobile_robot.model import MobileRobotModel

Numbers = NDArray[np.int64]
Flags = NDArray[np.bool_]

_HEADINGS = 120  # equally spaced headings; those of the start, the goal and the gaps come on top
_TOUCH = 1e-8  # m: forbidden places are smaller by this, since contact is free
_LONGEST = 8.0  # the longest single drive, in circumscribed radii
_RASTER = 6.0  # raster places in a circumscribed radius
_NEAR = 4  # so many headings next to each other count as one in the record of poses seen
_WAVES = 12  # rounds of a wave from the start or the goal
_MOST_DRIVES = 8000  # in a round
_WAVES_FROM_GAPS = 6
_MOST_DRIVES_FROM_GAPS = 4000
_AROUND_GAPS = (4.0, 12.0)  # circumscribed radii within which waves from gaps stay: the second if the first fails

_FULL_TURN = 2.0 * np.pi


def find_way(problem: MobileRobotModel, roomy: shapely.Geometry) -> Floats | None:
    """Return poses from the start to the goal between which the robot turns and drives alternately, or None.

    Headings are unwrapped. ``roomy`` is where the enclosing disc is free. None means only that no way was found.
    """
    gaps = _gaps(problem)
    space = _Space(problem, roomy, [problem.start[2], problem.goal[2], *gaps[:, 2]])
    # The goal's wave goes backwards: it holds poses from which drives ahead and turns lead to the goal.
    out = _Wave(space, np.array(problem.start), ahead=True)
    into = _Wave(space, np.array(problem.goal), ahead=False)
    passages: list[tuple[_Wave, _Wave]] = []
    reaches = iter(_AROUND_GAPS)
    for _ in range(_WAVES):
        out.spread()
        into.spread()
        if not (out.reached and into.reached):
            continue
        chain = _chain(out, into, passages)
        # There may be many gaps: their waves spread only once both ends have reached roomy parts that do not connect.
        while chain is None and (reach := next(reaches, None)) is not None:
            passages = [passage for gap in gaps for passage in _passages(space, gap, reach * space.radius)]
            chain = _chain(out, into, passages)
        if chain is not None:
            return _poses(space, _joined(space, out, into, *chain), problem)
    return None


# Free turns and drives ------------------------------------------------------------------------------------------------
class _Layer(NamedTuple):
    """Where the reference point must not be, for each of some headings or intervals of headings."""

    solids: NDArray[np.object_]  # shapely polygons
    owners: Numbers  # the number of the heading that each polygon is for
    tree: shapely.STRtree
    low: Points  # the lower corner of where the bounds let the reference point be, one for each heading
    high: Points  # the upper corner

    def blocks(self, places: Points) -> Flags:
        """Return which headings are blocked at each place, (places, headings)."""
        # The bounds are walls for the robot at each heading; low and high already have its extent and the clearance
        # taken off.
        outside = (places[:, None] < self.low - _TOUCH) | (places[:, None] > self.high + _TOUCH)
        blocked: Flags = np.any(outside, axis=2)
        at, solids = self.tree.query(shapely.points(places), predicate="intersects")
        blocked[at, self.owners[solids]] = True
        return blocked


class _Space:
    """The headings, what is free at each of them, and what is free on the turn from one to the next."""

    def __init__(self, problem: MobileRobotModel, roomy: shapely.Geometry, further: list[float]) -> None:
        self.headings = _distinct(np.concatenate([np.arange(_HEADINGS) * _FULL_TURN / _HEADINGS, further]))
        self.following = np.append(self.headings[1:], self.headings[0] + _FULL_TURN)
        self.standing = _layer(problem, self.headings, self.headings)
        self.turning = _layer(problem, self.headings, self.following)
        self.parts = np.array(list(parts(roomy)), dtype=object)
        shapely.prepare(self.parts)
        self.radius = problem.robot.circumscribed_radius
        self.origin = np.array(problem.bounds[:2])
        self.spacing = self.radius / _RASTER
        self.cells = tuple(int(side / self.spacing) + 1 for side in np.subtract(problem.bounds[2:], self.origin))
        self._trees = [
            (solids, shapely.STRtree(solids))
            for solids in (self.standing.solids[self.standing.owners == each] for each in range(len(self.headings)))
        ]

    def part_of(self, places: Points) -> Numbers:
        """Return the number of the roomy part that each place is in; -1 if it is in none."""
        found = np.full(len(places), -1)
        for number, part in enumerate(self.parts):
            found[shapely.contains_xy(part, places)] = number
        return found

    def index(self, heading: float) -> int:
        """Return the index of the nearest heading on the list."""
        off = np.abs((self.headings - heading + np.pi) % _FULL_TURN - np.pi)
        return int(off.argmin())

    def runs(self, places: Points) -> Numbers:
        """Return labels, (places, headings): at each place the robot can turn between headings of the same label."""
        # A heading's label is the number of blocked turns before it on the list. The turn from the last heading to the
        # first closes the circle: if it is free, the last run is part of the first.
        blocked = self.turning.blocks(places)
        labels = np.cumsum(blocked, axis=1)
        labels = np.column_stack([np.zeros(len(places), np.int64), labels[:, :-1]])
        around = ~blocked[:, -1:] & (labels == labels[:, -1:])
        return np.where(around, 0, labels)

    def is_free_turn(self, place: Points, begin: float, turn: float) -> bool:
        """Return whether the robot can surely turn at a place from one heading by an angle."""
        # Conservative: an interval of headings that the turn only partly covers must be free as a whole.
        blocked = self.turning.blocks(place[None])[0]
        low, high = min(begin, begin + turn), max(begin, begin + turn)
        touched = np.zeros(len(blocked), np.bool_)
        base = np.floor(low / _FULL_TURN) * _FULL_TURN
        for turns in (-_FULL_TURN, 0.0, _FULL_TURN):
            touched |= (self.headings + base + turns < high - 1e-9) & (self.following + base + turns > low + 1e-9)
        return not bool((touched & blocked).any())

    def free_lengths(self, places: Points, headings: Numbers, sense: float) -> Floats:
        """Return how far the robot can drive from each place, m: ahead if ``sense`` is 1, back if it is -1."""
        lengths = np.empty(len(places))
        for heading in np.unique(headings):
            rows = np.flatnonzero(headings == heading)
            angle = self.headings[heading]
            along = sense * np.array([np.cos(angle), np.sin(angle)])
            lengths[rows] = self._lengths_along(places[rows], heading, along)
        return lengths

    def _lengths_along(self, places: Points, heading: int, along: Points) -> Floats:
        # The nearest wall in the direction of the drive, then the nearest forbidden place on the line.
        far = np.where(along > 0.0, self.standing.high[heading], self.standing.low[heading])
        with np.errstate(divide="ignore", invalid="ignore"):
            to_bounds = np.where(np.abs(along) > 1e-12, (far - places) / along, np.inf).min(axis=1)
        lengths: Floats = np.clip(to_bounds, 0.0, _LONGEST * self.radius)
        lines = shapely.linestrings(np.stack([places, places + lengths[:, None] * along], axis=1))
        solids, tree = self._trees[heading]
        at, hit = tree.query(lines, predicate="intersects")
        away = shapely.distance(shapely.points(places[at]), shapely.intersection(lines[at], solids[hit]))
        np.minimum.at(lengths, at, away)
        return lengths


def _layer(problem: MobileRobotModel, begins: Floats, ends: Floats) -> _Layer:
    robot = convex(shapely.Polygon(problem.robot.vertices))
    solids: list[shapely.Geometry] = []
    owners: list[int] = []
    low, high = np.empty((len(begins), 2)), np.empty((len(begins), 2))
    for number, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        pieces = swept(robot, begin, end)
        low[number], high[number] = room_for(problem, np.concatenate(pieces), problem.clearance)
        for obstacle in problem.obstacles:
            for piece in pieces:
                solids += forbidden(obstacle, piece, surely=True)
        owners += [number] * (len(solids) - len(owners))
    shapes = np.array(solids, dtype=object)
    # Grown by the clearance and shrunk by the contact that is free; AROUND makes up for the flat sides of round
    # corners.
    shapes = shapely.buffer(shapes, problem.clearance * AROUND - _TOUCH, quad_segs=ARC, join_style="round")
    return _Layer(shapes, np.array(owners, np.int64), shapely.STRtree(shapes), low, high)


def _distinct(headings: Floats) -> Floats:
    """Return the headings in order, each in [0, 2π), without repeats."""
    ordered: Floats = np.sort(headings % _FULL_TURN)
    distinct: Floats = ordered[np.append(True, np.diff(ordered) > 1e-9)]
    return distinct


# Waves of poses -------------------------------------------------------------------------------------------------------
class _Wave:
    """The poses that can be reached from a pose (ahead), or from which that pose can be reached (not ahead).

    Only poses within ``reach`` of it are kept. Each knows its parent, so a trail leads from it to the first pose.
    """

    def __init__(self, space: _Space, pose: Floats, ahead: bool, reach: float = np.inf) -> None:
        self.space, self.sense, self.reach = space, 1.0 if ahead else -1.0, reach
        self.places = pose[None, :2].copy()
        self.headings = np.array([space.index(pose[2])])
        self.parents = np.array([-1])
        self.been = np.zeros((*space.cells, 1 + len(space.headings) // _NEAR), np.bool_)
        self.reached: dict[int, int] = {}  # the roomy parts that were reached, and the first pose in each
        self.front = np.array([0])
        self._note(self.front)

    def _note(self, rows: Numbers) -> None:
        """Record the poses that are in a roomy part; the others are the next front.

        Nothing spreads within a roomy part: the visibility graph connects its places.
        """
        found = self.space.part_of(self.places[rows])
        for row, part in zip(rows[found >= 0].tolist(), found[found >= 0].tolist(), strict=True):
            self.reached.setdefault(part, row)
        self.front = rows[found < 0]

    def spread(self, most: int = _MOST_DRIVES) -> None:
        """Turn and drive once more from each pose of the front; of too many drives only every n-th is made."""
        if not len(self.front):
            return
        runs = self.space.runs(self.places[self.front])
        here = runs[np.arange(len(runs)), self.headings[self.front]]
        rows, headings = np.nonzero(runs == here[:, None])
        chosen = slice(None, None, 1 + len(rows) // most)
        rows, headings = rows[chosen], headings[chosen]
        lengths = self.space.free_lengths(self.places[self.front[rows]], headings, self.sense)
        # Each drive is a ray of poses one raster step apart, with the place at contact as the last.
        stops = 1 + np.floor(np.maximum(lengths - _TOUCH, 0.0) / self.space.spacing).astype(np.int64)
        ray = np.repeat(np.arange(len(rows)), stops)
        step = 1 + np.arange(len(ray)) - np.repeat(np.cumsum(stops) - stops, stops)
        away = np.minimum(step * self.space.spacing, lengths[ray] - _TOUCH)
        angles = self.space.headings[headings[ray]]
        along = self.sense * np.column_stack([np.cos(angles), np.sin(angles)])
        places = self.places[self.front[rows[ray]]] + away[:, None] * along
        self._append(places, headings[ray], self.front[rows[ray]], away)

    def _append(self, places: Points, headings: Numbers, parents: Numbers, away: Floats) -> None:
        """Keep one new pose for each cell of the raster and group of headings, the one with the shortest drive."""
        order = np.argsort(away, kind="stable")
        near = np.hypot(*(places - self.places[0]).T) <= self.reach
        order = order[near[order] & (away[order] > _TOUCH)]
        cells = ((places[order] - self.space.origin) / self.space.spacing).astype(np.int64)
        keys = np.ravel_multi_index((*cells.T, headings[order] // _NEAR), self.been.shape, mode="clip")
        _, first = np.unique(keys, return_index=True)
        first = np.sort(first[~self.been.ravel()[keys[first]]])
        self.been.ravel()[keys[first]] = True
        chosen, begin = order[first], len(self.places)
        self.places = np.concatenate([self.places, places[chosen]])
        self.headings = np.concatenate([self.headings, headings[chosen]])
        self.parents = np.concatenate([self.parents, parents[chosen]])
        self._note(np.arange(begin, len(self.places)))

    def trail(self, part: int) -> list[Points]:
        """Return the places of the poses from the first pose of the wave to the one in a roomy part."""
        row, trail = self.reached[part], []
        while row >= 0:
            trail.append(self.places[row])
            row = int(self.parents[row])
        return trail[::-1]


# Gaps -----------------------------------------------------------------------------------------------------------------
def _gaps(problem: MobileRobotModel) -> Floats:
    """Return poses amid the gaps between two obstacles or walls too narrow for the enclosing disc, (n, 3).

    A gap has two poses, both heading through it, in opposite directions.
    """
    x0, y0, x1, y1 = problem.bounds
    corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    walls = [shapely.LineString([corners[side - 1], corners[side]]) for side in range(4)]
    solids = [
        shapely.Point(each.center).buffer(each.radius, quad_segs=ARC) if isinstance(each, Circle) else each.polygon
        for each in problem.obstacles
    ]
    wide = 2.0 * (problem.robot.circumscribed_radius + problem.clearance)
    poses = []
    for one, other in combinations([*solids, *walls], 2):
        # Obstacles that touch leave no gap, and through a wide one the enclosing disc gets by itself.
        if not 0.0 < shapely.distance(one, other) < wide:
            continue
        here, there = shapely.get_coordinates(shapely.shortest_line(one, other))
        across = np.arctan2(*(there - here)[::-1])
        poses += [(*(here + there) / 2.0, across + quarter) for quarter in (-np.pi / 2.0, np.pi / 2.0)]
    return np.array(poses).reshape(-1, 3)


def _passages(space: _Space, gap: Floats, reach: float) -> Iterator[tuple[_Wave, _Wave]]:
    """Yield the waves that lead to a gap and on from it, once they connect different roomy parts."""
    # A gap that is near to fewer than two roomy parts connects none.
    near = shapely.distance(space.parts, shapely.Point(gap[:2])) < reach
    if near.sum() < 2 or space.standing.blocks(gap[None, :2])[0, space.index(gap[2])]:
        return
    to, beyond = _Wave(space, gap, ahead=False, reach=reach), _Wave(space, gap, ahead=True, reach=reach)
    for _ in range(_WAVES_FROM_GAPS):
        to.spread(_MOST_DRIVES_FROM_GAPS)
        beyond.spread(_MOST_DRIVES_FROM_GAPS)
        if to.reached and beyond.reached and len(to.reached.keys() | beyond.reached.keys()) > 1:
            yield to, beyond
            return


class _Step(NamedTuple):
    """A passage through a gap, from one roomy part to another."""

    part: int
    to: _Wave
    beyond: _Wave
    following: int


def _chain(out: _Wave, into: _Wave, passages: list[tuple[_Wave, _Wave]]) -> tuple[int, list[_Step]] | None:
    """Return a part that the start reaches, and the fewest steps from there to one from which the goal is reached.

    Breadth-first search over the roomy parts; None if no passages connect them.
    """
    came: dict[int, list[_Step]] = {part: [] for part in out.reached}
    queue = deque(came)
    while queue:
        part = queue.popleft()
        if part in into.reached:
            steps = came[part]
            return (steps[0].part if steps else part), steps
        for to, beyond in passages:
            if part in to.reached:
                # Sorted, so that the oracle's answer does not depend on the order of a set.
                for following in sorted(beyond.reached.keys() - came.keys()):
                    came[following] = [*came[part], _Step(part, to, beyond, following)]
                    queue.append(following)
    return None


# The way --------------------------------------------------------------------------------------------------------------
def _joined(space: _Space, out: _Wave, into: _Wave, first: int, steps: list[_Step]) -> list[Points]:
    """Return the places where the robot turns, from the start to the goal."""
    places, part = out.trail(first), first
    for step in steps:
        places += _within(space, part, places[-1], step.to.trail(part)[-1])
        places += step.to.trail(part)[::-1] + step.beyond.trail(step.following)
        part = step.following
    places += _within(space, part, places[-1], into.trail(part)[-1])
    return places + into.trail(part)[::-1]


def _within(space: _Space, part: int, here: Points, there: Points) -> list[Points]:
    """Return the corners of the shortest way through a roomy part."""
    way = shortest_way(space.parts[part], tuple(here), tuple(there))
    assert way is not None, "both are in the part"
    return list(way)


def _poses(space: _Space, places: list[Points], problem: MobileRobotModel) -> Floats:
    """Return the poses from the start to the goal over these places: turns and drives, alternately."""
    poses = [np.array(problem.start)]
    for place in places:
        step = place - poses[-1][:2]
        if np.hypot(*step) > 1e-9:
            turned = _turned(space, poses[-1], float(np.arctan2(step[1], step[0])))
            poses += [turned, np.append(place, turned[2])]
    return np.array([*poses, _turned(space, poses[-1], problem.goal[2])])


def _turned(space: _Space, pose: Floats, heading: float) -> Floats:
    """Return the pose after a turn to a heading by the sense that is free, the shorter one if in doubt."""
    turn = shorter(heading - pose[2])
    longer = turn - np.copysign(_FULL_TURN, turn)
    if not space.is_free_turn(pose[:2], pose[2], turn) and space.is_free_turn(pose[:2], pose[2], longer):
        turn = longer
    turned: Floats = pose + np.array([0.0, 0.0, turn])
    return turned
