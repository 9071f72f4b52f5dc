import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from problems.robots.arm import BOX, CYLINDER
from problems.robots.gjk_kernels import GJK_ROOM, POINT, TRIANGLE, separation
from problems.robots.solid_kernels import distance_from_solid

ROOM = np.empty(GJK_ROOM)
COORDINATES = st.integers(-4, 4).map(lambda each: each / 4)
TRIANGLES = st.lists(COORDINATES, min_size=9, max_size=9).map(np.array)
SIZES = st.lists(st.sampled_from([0.25, 0.5, 1.0]), min_size=3, max_size=3)


def bound(triangle, kind, sizes=(0.0, 0.0, 0.0), other=None, enough=10.0, touching=0.0):
    if other is not None:
        ROOM[4:7] = np.reshape(other, (3, 3))
    return separation(*np.ravel(triangle), kind, *sizes, enough, touching, ROOM)


def points_of(triangle, steps=24):
    """Points of a triangle, its corners and edges included."""
    u, v = np.meshgrid(np.linspace(0, 1, steps + 1), np.linspace(0, 1, steps + 1))
    inside = u + v <= 1 + 1e-12
    u, v = u[inside], v[inside]
    a, b, c = np.reshape(triangle, (3, 3))
    return np.outer(1 - u - v, a) + np.outer(u, b) + np.outer(v, c)


def flat(coal, triangle):
    """A triangle as one of coal's convex shapes: its own kind of triangle has no distance from solids."""
    corners, sides = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in triangle:
        corners.append(corner)
    for side in ((0, 1, 2), (0, 2, 1)):
        sides.append(coal.Triangle(*side))
    return coal.Convex(corners, sides)


def solid_distance(kind, point, sizes):
    return max(0.0, distance_from_solid(kind, *point, *sizes))


@pytest.mark.parametrize("kind", [BOX, CYLINDER, POINT, TRIANGLE])
def test_distances_are_those_of_coal(kind):
    coal = pytest.importorskip("coal")
    rng = np.random.default_rng(kind)
    request = coal.DistanceRequest()
    for _ in range(1000):
        triangle, other = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)) * 0.5 + rng.normal(size=3)
        triangle = triangle * rng.choice([0.03, 1.0]) + rng.normal(size=3)
        sizes = rng.uniform(0.1, 0.8, 3)
        shapes = {
            BOX: lambda s: coal.Box(*(2 * s)),
            CYLINDER: lambda s: coal.Cylinder(s[0], 2 * s[2]),
            POINT: lambda s: coal.Sphere(1e-9),
            TRIANGLE: lambda s: flat(coal, other),  # noqa: B023
        }
        here = coal.Transform3s()
        expected = coal.distance(flat(coal, triangle), here, shapes[kind](sizes), here, request, coal.DistanceResult())
        found = bound(triangle, kind, sizes, other)
        if expected > 1e-6:
            assert found == pytest.approx(expected, abs=1e-5)
        else:
            assert found < 2e-6


@given(TRIANGLES, SIZES, st.sampled_from([BOX, CYLINDER]))
@settings(max_examples=400, deadline=None)
def test_a_bound_is_never_above_the_distance_of_any_point(triangle, sizes, kind):
    if kind == CYLINDER:
        sizes[1] = sizes[0]
    distances = [solid_distance(kind, point, sizes) for point in points_of(triangle)]
    found = bound(triangle, kind, sizes)
    assert found <= min(distances) + 1e-12
    longest = np.ptp(np.reshape(triangle, (3, 3)), axis=0).sum()
    assert max(found, 0.0) >= min(distances) - longest / 24 - 1e-9


@given(TRIANGLES, TRIANGLES)
@settings(max_examples=400, deadline=None)
def test_a_bound_between_triangles_is_never_above_the_distance_of_any_points(triangle, other):
    mine, others = points_of(triangle, 12), points_of(other, 12)
    least = np.sqrt(((mine[:, None] - others[None]) ** 2).sum(axis=2).min())
    found = bound(triangle, TRIANGLE, other=other)
    assert found <= least + 1e-12
    spacing = sum(np.ptp(np.reshape(each, (3, 3)), axis=0).sum() / 12 for each in (triangle, other))
    assert max(found, 0.0) >= least - spacing - 1e-6


@given(TRIANGLES, st.lists(st.floats(0, 1), min_size=2, max_size=2), TRIANGLES)
@settings(max_examples=300, deadline=None)
def test_triangles_that_share_a_point_are_never_apart(triangle, shares, other):
    u, v = shares if sum(shares) <= 1 else (1 - shares[0], 1 - shares[1])
    a, b, c = np.reshape(triangle, (3, 3))
    moved = np.reshape(other, (3, 3)) - np.reshape(other, (3, 3))[0] + (1 - u - v) * a + u * b + v * c
    assert bound(triangle, TRIANGLE, other=moved) <= 1e-12


@given(TRIANGLES, SIZES, st.floats(0, 2))
@settings(max_examples=200, deadline=None)
def test_a_search_that_ends_early_agrees_with_the_distance(triangle, sizes, threshold):
    distance = bound(triangle, BOX, sizes)
    early = bound(triangle, BOX, sizes, enough=threshold, touching=threshold)
    if abs(distance - threshold) > 1e-6:
        assert (early > threshold) == (distance > threshold)


@pytest.mark.parametrize("kind", [BOX, CYLINDER, POINT])
def test_a_triangle_without_an_area_is_a_segment_or_a_point(kind):
    sizes = (0.5, 0.5, 0.5) if kind != POINT else (0.0, 0.0, 0.0)
    edge = 1.5 if kind != POINT else 2.0
    assert bound([2, 0, 0] * 3, kind, sizes) == pytest.approx(edge, abs=1e-9)
    assert bound([2, -1, 0, 2, 1, 0, 2, 0, 0], kind, sizes) == pytest.approx(edge, abs=1e-9)
    assert bound([2, -1, 0, 2, 1, 0, 2, -1, 0], kind, sizes) == pytest.approx(edge, abs=1e-9)
