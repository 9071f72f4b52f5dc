"""The closed forms of contact against shapely, sampled densely, in thousands of random worlds."""

import numpy as np
import pytest
import shapely

from lowlevel.compiled import kernel
from problems.mobile_robot.arrays import floor_arrays, robot_arrays
from problems.mobile_robot.contact import Floor, Robot, can_turn, drive
from problems.plane import CONTACT, Box, Circle, Polygon

WORLDS = 2000
POSES = 2  # in each world
SIZE = 4.0  # m, of a square floor
BOUNDS = (0.0, 0.0, SIZE, SIZE)
DEPTH = 1e-6  # m, deeper than which shapes are surely in each other
ROUND = 1e-4  # m, by which shapely's polygons with many corners fall short of discs
GRAIN = 2e-3  # m, what sampling a turn can miss
ASIDE = 1e-2  # m, how far beyond a hit the robot is in it
SQUARE = [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]


@kernel(
    "float64[:,::1](float64[:,::1], float64[:,::1], float64, float64, float64[::1], float64[:,::1], int64[::1],"
    "float64[::1], float64[:,::1], float64[:,::1])"
)
def motions(poses, outline, robot_thickness, reach, bounds, corners, starts, thickness, boxes, middles):
    """For rows of x, y, heading, turn: how far to a hit, how far to a stop, and whether the turn is free."""
    robot = Robot(outline, robot_thickness, reach)
    floor = Floor(bounds, corners, starts, thickness, boxes, middles)
    found = np.empty((len(poses), 3))
    for row in range(len(poses)):
        x, y, heading, turn = poses[row]
        found[row, 0], found[row, 1] = drive(robot, floor, x, y, heading, np.inf)
        found[row, 2] = can_turn(robot, floor, x, y, heading, turn)
    return found


def ask(poses, body, obstacles, bounds=BOUNDS):
    """Hit, stop and whether the turn is free, for a body of vertices or a radius."""
    disc = isinstance(body, float)
    outline, thickness = robot_arrays(None if disc else body, body if disc else None)
    reach = float(np.linalg.norm(outline, axis=1).max())
    return motions(np.array(poses), outline, thickness, reach, *floor_arrays(bounds, obstacles))


def box(x0, y0, x1, y1):
    return Box(shape="box", center=((x0 + x1) / 2, (y0 + y1) / 2), size=(x1 - x0, y1 - y0))


def circle(x, y, radius):
    return Circle(shape="circle", center=(x, y), radius=radius)


# Random worlds --------------------------------------------------------------------------------------------------------
def star(generator, radius):
    """A polygon, mostly concave, around a point near the origin."""
    corners = int(generator.integers(3, 8))
    bearings = (np.arange(corners) + generator.uniform(0.1, 0.9, corners)) * 2 * np.pi / corners
    radii = radius * generator.uniform(0.3, 1.0, corners)
    points = np.column_stack([radii * np.cos(bearings), radii * np.sin(bearings)])
    return [tuple(point) for point in points + generator.uniform(-0.1, 0.1, 2)]


def random_obstacle(generator):
    center = tuple(generator.uniform(0.0, SIZE, 2))
    match generator.integers(3):
        case 0:
            return circle(*center, generator.uniform(0.05, 0.5))
        case 1:
            size, angle = tuple(generator.uniform(0.05, 1.5, 2)), generator.uniform(0, np.pi)
            return Box(shape="box", center=center, size=size, angle=angle)
        case _:
            corners = star(generator, generator.uniform(0.2, 0.9))
            return Polygon(shape="polygon", vertices=[tuple(np.add(corner, center)) for corner in corners])


def solid(obstacle, grown):
    if isinstance(obstacle, Circle):
        return shapely.Point(obstacle.center).buffer(obstacle.radius + grown, quad_segs=64)
    return obstacle.polygon.buffer(grown, join_style="mitre")


class World:
    """A random world, and what shapely says of motions in it."""

    def __init__(self, number):
        generator = np.random.default_rng([1992, number])
        self.body = float(generator.uniform(0.1, 0.4)) if number % 4 == 0 else star(generator, 0.5)
        self.is_disc = isinstance(self.body, float)
        outline = shapely.Point(0, 0).buffer(self.body, quad_segs=64) if self.is_disc else shapely.Polygon(self.body)
        self.corners = np.array(outline.exterior.coords[:-1]) @ [1, 1j]
        self.obstacles = [random_obstacle(generator) for _ in range(generator.integers(1, 6))]
        self.clear = self.grown(ROUND)
        self.poses = [pose for _ in range(20) if self.is_free(pose := self.pose(generator))][:POSES]

    @staticmethod
    def pose(generator):
        return (*generator.uniform(0, SIZE, 2), generator.uniform(-np.pi, np.pi), generator.uniform(-6.28, 6.28))

    def grown(self, by):
        """All that is solid, the walls included, grown (or shrunk, if negative)."""
        outside = shapely.box(-9, -9, SIZE + 9, SIZE + 9) - shapely.box(by, by, SIZE - by, SIZE - by)
        result = shapely.union_all([solid(obstacle, by) for obstacle in self.obstacles] + [outside])
        shapely.prepare(result)
        return result

    def placed(self, x, y, headings):
        corners = complex(x, y) + np.exp(1j * np.atleast_1d(headings))[:, None] * self.corners
        return np.stack([corners.real, corners.imag], axis=-1)

    def is_free(self, pose):
        return not shapely.Polygon(self.placed(*pose[:3])[0]).intersects(self.clear)

    def driven(self, pose, length):
        """Shapes that cover a drive ahead: the robot at both ends, and the hull of each edge at both."""
        x, y, heading, _ = pose
        ends = (
            self.placed(x, y, heading)[0],
            self.placed(x + length * np.cos(heading), y + length * np.sin(heading), heading)[0],
        )
        edges = np.concatenate([ends[0], np.roll(ends[0], -1, axis=0), ends[1], np.roll(ends[1], -1, axis=0)], axis=1)
        hulls = shapely.convex_hull(shapely.multipoints(edges.reshape(-1, 4, 2)))
        return np.concatenate([shapely.polygons(np.stack(ends)), hulls])

    def turned(self, pose):
        """The robot at many headings of a turn."""
        x, y, heading, turn = pose
        return shapely.polygons(self.placed(x, y, heading + np.linspace(0, turn, 2 + int(abs(turn) * 150))))


@pytest.fixture(scope="module")
def worlds():
    return [world for number in range(WORLDS) if (world := World(number)).poses]


def test_the_free_length_is_that_of_shapely(worlds):
    for world in worlds:
        solids, certain = world.grown(-DEPTH), world.grown(ROUND)
        for pose, (hit, stop, _) in zip(world.poses, ask(world.poses, world.body, world.obstacles), strict=True):
            assert 0.0 < stop <= hit < 2 * SIZE
            assert not shapely.intersects(world.driven(pose, stop), solids).any(), (pose, stop)
            assert shapely.intersects(world.driven(pose, hit + ASIDE), certain).any(), (pose, hit)


def test_turns_are_those_of_shapely(worlds):
    free = blocked = 0
    for world in worlds:
        if world.is_disc:
            continue
        solids, certain = world.grown(-DEPTH), world.grown(GRAIN)
        for pose, (_, _, can) in zip(world.poses, ask(world.poses, world.body, world.obstacles), strict=True):
            swept = world.turned(pose)
            assert not (can and shapely.intersects(swept, solids).any()), pose
            assert can or shapely.intersects(swept, certain).any(), pose
            free, blocked = free + bool(can), blocked + (not can)
    assert min(free, blocked) > WORLDS / 4


def test_a_disc_turns_anywhere(worlds):
    discs = [world for world in worlds if world.is_disc]
    assert discs
    assert all(ask(world.poses, world.body, world.obstacles)[:, 2].all() for world in discs)


# Contact --------------------------------------------------------------------------------------------------------------
def hit_stop(pose, body, obstacles, bounds=(-10.0, -10.0, 10.0, 10.0)):
    return ask([(*pose, 0.0)], body, obstacles, bounds)[0, :2]


def turns(pose, turn, body, obstacles, bounds=(-10.0, -10.0, 10.0, 10.0)):
    return bool(ask([(*pose, turn)], body, obstacles, bounds)[0, 2])


@pytest.mark.parametrize("body", [SQUARE, 0.5], ids=["polygon", "disc"])
@pytest.mark.parametrize(
    ("obstacles", "length"),
    [
        ([], 9.5),  # the wall
        ([box(3, -1, 4, 1)], 2.5),
        ([box(3, -0.1, 4, 0.1)], 2.5),  # narrower than the robot: its corners or its face meet the front
        ([circle(3, 0, 0.75)], 1.75),
        ([box(3, 0.5, 4, 2)], 9.5),  # alongside, flush
        ([box(-3, -1, -2, 1)], 9.5),  # behind
    ],
)
def test_the_robot_stops_where_it_touches(body, obstacles, length):
    hit, stop = hit_stop((0, 0, 0), body, obstacles)
    assert stop == pytest.approx(length, abs=1e-8)
    assert stop < hit < stop + 1e-6


def test_a_robot_that_touches_a_wall_slides_along_it_and_along_the_next_that_adjoins_flush():
    walls = [box(1, -5, 2, 0), box(1, 0, 2, 5), box(-5, 6, 5, 7)]
    _, stop = hit_stop((0, -2, 0), SQUARE, walls)
    assert stop == pytest.approx(0.5, abs=1e-8)
    _, along = hit_stop((stop, -2, np.pi / 2), SQUARE, walls)
    assert along == pytest.approx(7.5, abs=1e-8)


@pytest.mark.parametrize("heading", [0.0, np.pi / 2, np.pi, -np.pi / 2])
def test_a_robot_that_touches_the_bounds_slides_along_them_and_cannot_leave(heading):
    bounds = (0.0, 0.0, 8.0, 8.0)
    pose = np.array([4.0, 4.0])
    ahead, aside = np.array([np.cos(heading), np.sin(heading)]), np.array([-np.sin(heading), np.cos(heading)])
    _, stop = hit_stop((*pose, heading), SQUARE, [], bounds)
    assert stop == pytest.approx(3.5, abs=1e-8)
    touching = pose + stop * ahead
    assert hit_stop((*touching, heading), SQUARE, [], bounds)[1] == pytest.approx(0.0, abs=1e-8)
    _, along = hit_stop((*touching, heading + np.pi / 2), SQUARE, [], bounds)
    assert along == pytest.approx(3.5, abs=1e-8)
    corner = touching + along * aside
    assert hit_stop((*corner, heading + np.pi / 2), SQUARE, [], bounds)[1] == pytest.approx(0.0, abs=1e-8)


def test_a_door_exactly_as_wide_as_the_robot_lets_it_through():
    door = [box(2, -3, 3, -0.5), box(2, 0.5, 3, 3)]
    assert hit_stop((0, 0, 0), SQUARE, door)[1] == pytest.approx(9.5, abs=1e-8)
    narrow = [box(2, -3, 3, -0.5 + 1e-6), box(2, 0.5, 3, 3)]
    assert hit_stop((0, 0, 0), SQUARE, narrow)[1] == pytest.approx(1.5, abs=1e-5)


def test_corners_that_meet_head_on_are_blocked():
    diamond = [(0.5, 0.0), (0.0, 0.5), (-0.5, 0.0), (0.0, -0.5)]
    obstacle = Box(shape="box", center=(3.0, 0.0), size=(1.0, 1.0), angle=np.pi / 4)
    assert hit_stop((0, 0, 0), diamond, [obstacle])[1] == pytest.approx(2.5 - np.sqrt(0.5), abs=1e-8)


def test_a_square_turns_where_its_circle_fits_and_in_no_corridor_narrower_than_that():
    diagonal = np.sqrt(0.5)
    for room, free in ((diagonal + 1e-8, True), (diagonal - 1e-6, False)):
        corridor = [box(-5, room, 5, room + 1), box(-5, -room - 1, 5, -room)]
        assert turns((0, 0, 0), np.pi / 2, SQUARE, corridor) is free
        assert turns((0, 0, 0), -np.pi / 2, SQUARE, corridor) is free


def test_contact_blocks_only_the_sense_that_leads_into_it():
    beam = [(-0.1, -0.1), (1.0, -0.1), (1.0, 0.1), (-0.1, 0.1)]
    above = [box(0.5, 0.1, 2, 1)]
    assert not turns((0, 0, 0), 0.01, beam, above)
    assert turns((0, 0, 0), -np.pi, beam, above)
    assert not turns((0, 0, 0), -2 * np.pi, beam, above)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_turn_goes_as_far_as_the_obstacle_and_no_farther(sense):
    beam = [(-0.1, -1e-3), (1.0, -1e-3), (1.0, 1e-3), (-0.1, 1e-3)]
    ball = [circle(0.0, sense * 0.8, 0.2)]
    contact = np.pi / 2 - np.arcsin(0.201 / 0.8)
    assert turns((0, 0, 0), sense * (contact - 1e-6), beam, ball)
    assert not turns((0, 0, 0), sense * (contact + 1e-6), beam, ball)
    assert turns((0, 0, 0), -sense * (np.pi + contact - 0.01), beam, [circle(0.0, sense * 0.8, 0.2)])


def test_a_move_to_contact_at_any_heading_leaves_the_robot_where_it_can_come_back():
    generator = np.random.default_rng(5)
    for heading in generator.uniform(-np.pi, np.pi, 200):
        _, stop = hit_stop((0, 0, heading), SQUARE, [box(2, -6, 3, 6), box(-6, 2, 6, 3), circle(-3, -3, 1)])
        x, y = stop * np.cos(heading), stop * np.sin(heading)
        _, again = hit_stop((x, y, heading), SQUARE, [box(2, -6, 3, 6), box(-6, 2, 6, 3), circle(-3, -3, 1)])
        assert abs(again) < 10 * CONTACT
