import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_robots import lump, on_surface

from problems.robots.hulls import MOST_TRIANGLES, simplified
from problems.robots.shapes import cut_to_size, primitive
from problems.robots.trees import tree_of

ROUNDING = 1e-9


def levels_of(spheres, children):
    """Yield the numbers of the spheres on each level; a leaf stays on all levels below its own."""
    level = [0]
    while True:
        yield np.array(level)
        below = [
            range(int(a), int(a + n)) if a >= 0 else [node] for node, (a, n) in zip(level, children[level], strict=True)
        ]
        if all(a < 0 for a in children[level, 0]):
            return
        level = [each for part in below for each in part]


def is_covered(points, spheres):
    covered = np.zeros(len(points), bool)
    for sphere in spheres:
        covered |= ((points - sphere[:3]) ** 2).sum(axis=1) <= sphere[3] ** 2
    return covered


@pytest.mark.parametrize("leaf", [0.01, 0.03])
def test_every_level_of_spheres_covers_the_mesh(leaf):
    vertices, triangles = lump(3, rows=14)
    soup = vertices[triangles]
    spheres, children, _ = tree_of(cut_to_size(soup, 2 * leaf), leaf)
    points = on_surface(soup, 4000)
    for level in levels_of(spheres, children):
        assert is_covered(points, spheres[level]).all()


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.sampled_from([1.0, 1e-3, 50.0]))
def test_a_sphere_contains_all_triangles_under_it_and_each_triangle_is_under_one_leaf(seed, count, size):
    soup = np.random.default_rng(seed).normal(size=(count, 3, 3)) * size
    spheres, children, triangles = tree_of(soup, 0.3 * size)
    assert len(triangles) == count
    assert {tuple(each) for each in triangles} == {tuple(each) for each in soup.reshape(-1, 9)}
    held = [[] for _ in spheres]
    for node in range(len(spheres) - 1, -1, -1):
        first, below = children[node]
        held[node] = range(-first - 1, -first - 1 + below) if first < 0 else [
            each for child in range(first, first + below) for each in held[child]
        ]  # fmt: skip
        corners = triangles[list(held[node])].reshape(-1, 3)
        assert (np.linalg.norm(corners - spheres[node, :3], axis=1) <= spheres[node, 3]).all()
    assert sorted(held[0]) == list(range(count))
    assert np.array_equal(spheres, spheres.astype(np.float32))


def test_equal_triangles_end_in_leaves():
    spheres, children, triangles = tree_of(np.ones((40, 3, 3)), 1e-12)
    assert len(triangles) == 40
    assert (spheres[:, 3] > 0).all()
    assert children[children[:, 0] < 0, 1].sum() == 40


def is_in_hull(points, soup, depth=1e-9):
    """Return whether each point is inside the convex hull of the soup, or at most ``depth`` outside."""
    from scipy.spatial import ConvexHull

    planes = ConvexHull(soup.reshape(-1, 3)).equations
    return (points @ planes[:, :3].T + planes[:, 3]).max(axis=1) <= depth


@pytest.mark.parametrize(("shape", "size", "inside"), [
    ("box", (0.1, 0.2, 0.3), lambda p: np.abs(p) <= np.array([0.05, 0.1, 0.15])),
    ("sphere", (0.07,), lambda p: np.linalg.norm(p, axis=1) <= 0.07),
    ("cylinder", (0.05, 0.3), lambda p: (np.hypot(p[:, 0], p[:, 1]) <= 0.05) & (np.abs(p[:, 2]) <= 0.15)),
    ("capsule", (0.05, 0.2), lambda p: np.linalg.norm(p - np.clip(p, [0, 0, -0.1], [0, 0, 0.1]), axis=1) <= 0.05),
])  # fmt: skip
def test_triangles_of_a_primitive_contain_it_and_are_close(shape, size, inside):
    soup = primitive(shape, size)
    points = np.random.default_rng(1).uniform(-0.2, 0.2, (2000, 3))
    own = np.atleast_2d(inside(points).T).all(axis=0)
    contained = is_in_hull(points, soup)
    assert contained[own].all()
    near = inside(points * 0.95)  # the triangles stick out by less than 5 %
    assert np.atleast_2d(near.T).all(axis=0)[contained].all()


def test_cutting_keeps_the_surface():
    soup = primitive("box", (1.0, 0.5, 0.02))
    cut = cut_to_size(soup, 0.1)
    assert np.linalg.norm(cut - np.roll(cut, 1, axis=1), axis=2).max() <= 0.1
    area = [
        np.linalg.norm(np.cross(each[:, 1] - each[:, 0], each[:, 2] - each[:, 0]), axis=1).sum() for each in (soup, cut)
    ]
    assert area[0] == pytest.approx(area[1])


def test_large_meshes_become_hulls_that_contain_them():
    vertices, triangles = lump(5, rows=29)
    soup = vertices[triangles]
    assert len(soup) > MOST_TRIANGLES
    few = simplified(soup)
    points = on_surface(soup, 3000)
    assert is_in_hull(points, few).all()
    # A ray outwards from any point of the mesh crosses the hulls' surface: they enclose it.
    far = few.reshape(-1, 3)
    assert (far.min(axis=0) <= points.min(axis=0) + ROUNDING).all()
    assert (far.max(axis=0) >= points.max(axis=0) - ROUNDING).all()


def test_each_part_of_a_large_mesh_is_inside_a_hull_of_its_own(monkeypatch):
    from problems.robots import hulls

    parts, original = [], hulls._with_shells
    monkeypatch.setattr(hulls, "_with_shells", lambda points: parts.append((points, original(points))) or parts[-1][1])
    vertices, triangles = lump(7, rows=29)
    hulls.simplified(vertices[triangles])
    assert sum(len(points) for points, _ in parts) >= len(np.unique(vertices, axis=0))
    for points, hull in parts:
        assert is_in_hull(points, hull).all()


def test_a_flat_mesh_gets_a_box():
    random = np.random.default_rng(0)
    points = (random.random((3000, 1, 3)) + 0.02 * random.random((3000, 3, 3))) * [1.0, 1.0, 0.0]
    few = simplified(points)
    assert is_in_hull(points.reshape(-1, 3), few).all()
