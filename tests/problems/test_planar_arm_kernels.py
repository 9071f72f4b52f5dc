"""The compiled collision tests of arms, held against shapely and against cases with an obvious answer."""

import numpy as np
import pytest
import shapely

from problems.arm_ik import ArmIk
from problems.planar_arm.model import Arm
from problems.plane import Circle

AMBIGUOUS = 1e-7  # m: nearer to contact than this, either answer will do
BOX = {"shape": "box", "center": [1.0, -0.5], "size": [1.0, 1.0]}  # its upper side on y = 0, from x = 0.5 to 1.5
L_SHAPE = {"shape": "polygon", "vertices": [[1, -1], [3, -1], [3, 0], [2, 0], [2, 1], [1, 1]]}  # reflex corner (2, 0)


def random_world(generator, radius, links):
    """An arm of random links, and discs, boxes and star-shaped polygons around it."""
    arm = {"links": generator.uniform(0.3, 1.0, links).tolist(), "radius": radius}
    obstacles = []
    for shape in generator.choice(["circle", "box", "polygon"], generator.integers(1, 6)):
        center = generator.uniform(-2, 2, 2)
        size = float(generator.uniform(0.05, 0.6))
        if shape == "circle":
            obstacles.append({"shape": shape, "center": center.tolist(), "radius": size})
        elif shape == "box":
            sides = generator.uniform(0.05, 1.0, 2).tolist()
            obstacles.append({"shape": shape, "center": center.tolist(), "size": sides, "angle": size})
        else:
            bearings = np.sort(generator.uniform(0, 2 * np.pi, 7))
            radii = generator.uniform(0.2, 1.5, (7, 1)) * size
            star = center + radii * np.column_stack([np.cos(bearings), np.sin(bearings)])
            if shapely.Polygon(star).is_valid:
                obstacles.append({"shape": shape, "vertices": star.tolist()})
    fields = {"kind": "arm-ik", "target": [0, 0], "arm": arm, "obstacles": obstacles}
    try:
        return ArmIk.model_validate(fields)
    except ValueError:  # the base stands in an obstacle
        return random_world(generator, radius, links)


def links_of(problem, configurations):
    """Shapely lines, shape (n, links)."""
    headings = np.cumsum(configurations, axis=1)
    steps = np.array(problem.arm.links)[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=2)
    joints = np.concatenate([np.zeros((len(configurations), 1, 2)), np.cumsum(steps, axis=1)], axis=1)
    return shapely.linestrings(np.stack([joints[:, :-1], joints[:, 1:]], axis=2))


def obstacle_clearance(lines, obstacle, radius):
    """At least AMBIGUOUS from 0 wherever it is clear whether a link is in the obstacle; negative if it is."""
    if isinstance(obstacle, Circle):
        return shapely.distance(lines, shapely.Point(obstacle.center)) - obstacle.radius - radius
    solid = shapely.Polygon(obstacle.outline)
    if radius:
        return shapely.distance(lines, solid) - radius
    reaches = shapely.intersects(lines, solid.buffer(AMBIGUOUS))
    enters = shapely.intersects(lines, solid.buffer(-AMBIGUOUS))
    return np.where(enters, -1.0, np.where(reaches, 0.0, 1.0))


def own_clearance(lines, radius):
    """The same for links that are not neighbours."""
    least = np.full(len(lines), np.inf)
    for one in range(lines.shape[1]):
        for other in range(one + 2, lines.shape[1]):
            first, second = lines[:, one], lines[:, other]
            if radius:
                clearance = shapely.distance(first, second) - 2 * radius
            else:
                ends = np.stack(
                    [shapely.distance(shapely.get_point(first, end), second) for end in (0, 1)]
                    + [shapely.distance(shapely.get_point(second, end), first) for end in (0, 1)]
                ).min(axis=0)
                clearance = np.where(shapely.crosses(first, second), -ends, ends)
            least = np.minimum(least, clearance)
    return least


@pytest.mark.parametrize("radius", [0.0, 0.02, 0.1])
@pytest.mark.parametrize("links", [1, 2, 3, 5])
def test_collisions_agree_with_shapely(radius, links):
    generator = np.random.default_rng([links, int(1000 * radius)])
    judged = hit = 0
    for _ in range(60):
        problem = random_world(generator, radius, links)
        configurations = generator.uniform(-np.pi, np.pi, (150, links))
        lines = links_of(problem, configurations)
        clearance = own_clearance(lines, radius)
        for obstacle in problem.obstacles:
            clearance = np.minimum(clearance, obstacle_clearance(lines, obstacle, radius).min(axis=1))
        clear = np.abs(clearance) > AMBIGUOUS
        found = np.isinf(problem.distances(configurations))
        np.testing.assert_array_equal(found[clear], clearance[clear] < 0)
        judged, hit = judged + clear.sum(), hit + found.sum()
    assert judged > 0.99 * 60 * 150
    assert 0.05 * judged < hit < 0.99 * judged


def collides(obstacles, links, angles, radius=0.0, base=(0.0, 0.0), self_collision=True):
    """The kernel's own answer, even for a base in an obstacle."""
    fields = {"kind": "arm-ik", "target": [0, 0], "self_collision": self_collision, "obstacles": obstacles}
    elsewhere = ArmIk.model_validate(fields | {"arm": {"links": [1.0], "base": [99, 99]}})
    arm = Arm.model_validate({"links": links, "base": base, "radius": radius})
    return bool(np.isinf(elsewhere.model_copy(update={"arm": arm}).distances(np.array([angles], float))[0]))


@pytest.mark.parametrize(
    ("obstacles", "links", "angles", "radius", "base"),
    [
        ([{"shape": "circle", "center": [1, 0.5], "radius": 0.3}], [2], [0], 0.2, (0, 0)),
        ([{"shape": "circle", "center": [2.5, 0], "radius": 0.3}], [2], [0], 0.2, (0, 0)),
        ([{"shape": "circle", "center": [1, 0.3], "radius": 0.3}], [2], [0], 0.0, (0, 0)),
        ([BOX], [2], [0], 0.25, (0, 0.25)),
        ([BOX], [2], [0], 0.0, (0, 0)),  # along a side
        ([BOX], [0.5], [0], 0.0, (0, -0.5)),  # up to a side
        ([BOX], [np.sqrt(2)], [-np.pi / 4], 0.0, (0, 1)),  # ends on its upper side
        ([BOX], [1], [np.pi / 4], 0.0, (0, -0.5)),  # touches the upper left corner
        ([L_SHAPE], [1], [0], 0.0, (2, 0)),  # from the reflex corner along a side
        ([L_SHAPE], [1], [np.pi / 4], 0.0, (2, 0)),  # from the reflex corner outwards
    ],
)
def test_contact_is_free(obstacles, links, angles, radius, base):
    assert not collides(obstacles, links, angles, radius, base)


@pytest.mark.parametrize(
    ("obstacles", "links", "angles", "radius", "base"),
    [
        ([{"shape": "circle", "center": [1, 0.499999], "radius": 0.3}], [2], [0], 0.2, (0, 0)),
        ([{"shape": "circle", "center": [1, 0.299999], "radius": 0.3}], [2], [0], 0.0, (0, 0)),
        ([{"shape": "circle", "center": [0, 0], "radius": 3}], [1], [0], 0.0, (0, 0)),  # wholly inside
        ([BOX], [2], [0], 0.250001, (0, 0.25)),
        ([BOX], [2], [0], 0.0, (0, -1e-6)),  # just under a side
        ([BOX], [0.500001], [0], 0.0, (0, -0.5)),  # just into a side
        ([BOX], [0.1], [0], 0.0, (1, -0.5)),  # wholly inside
        ([BOX], [0.1], [0], 0.2, (1, -0.5)),  # wholly inside and thick
        ([BOX], [3], [0], 0.0, (0, -0.5)),  # right through
        ([BOX], [np.sqrt(2)], [-np.pi / 4], 0.0, (0.5, 0)),  # from corner to corner
        ([L_SHAPE], [2 * np.sqrt(2)], [-np.pi / 4], 0.0, (1, 1)),  # its middle touches the reflex corner
        ([L_SHAPE], [1], [np.pi * 5 / 4], 0.0, (2, 0)),  # from the reflex corner inwards
    ],
)
def test_more_than_contact_is_a_collision(obstacles, links, angles, radius, base):
    assert collides(obstacles, links, angles, radius, base)


def test_links_that_are_not_neighbours_must_not_cross():
    crossing = [0, 3 * np.pi / 4, 3 * np.pi / 4]  # the third link comes back down through the first
    assert collides([], [1, 1, 1], crossing)
    assert not collides([], [1, 1, 1], crossing, self_collision=False)
    assert not collides([], [1, 1], crossing[:2])  # neighbours may lie on each other


def test_links_may_touch():
    square = [0, np.pi / 2, np.pi / 2, np.pi / 2]
    assert not collides([], [1, 1, 1, 0.5], square)
    assert not collides([], [1, 1, 1, 1], square)  # the tip just touches the base
    assert collides([], [2, 1, 1, 1.000001], square)  # and here comes through the first link
    assert not collides([], [1, 0.2, 1], [0, np.pi / 2, np.pi / 2], radius=0.1)  # side by side
    assert collides([], [1, 0.2, 1], [0, np.pi / 2, np.pi / 2], radius=0.1 + 1e-6)
    assert not collides([], [1, 1, 1], [0, np.pi, np.pi])  # bare links folded onto each other


def test_a_huge_polygon_contains_the_whole_arm():
    around = {"shape": "polygon", "vertices": [[-9, -9], [9, -9], [0, 20]]}
    for radius in (0.0, 0.1):
        assert collides([around], [1, 1], [0.3, 0.4], radius)


def test_repeated_corners_change_nothing():
    doubled = BOX | {"shape": "polygon", "vertices": [[0.5, 0], [0.5, 0], [0.5, -1], [1.5, -1], [1.5, 0]]}
    del doubled["center"], doubled["size"]
    for base, angle in [((0, 0), 0.0), ((0, -0.5), 0.0), ((0, 0.5), -0.3), ((1, 0.2), -1.5)]:
        for radius in (0.0, 0.1):
            expected = collides([BOX], [1.2], [angle], radius, base)
            assert collides([doubled], [1.2], [angle], radius, base) == expected
