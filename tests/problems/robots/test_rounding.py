"""Rounded corners: near the path, smooth, and only where they are free."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from problems.robots.rounding import rounded, simplified

SEEDS = st.integers(0, 2**32)


def random_path(seed):
    rng = np.random.default_rng(seed)
    return rng.uniform(-2.0, 2.0, (rng.integers(2, 7), rng.integers(1, 8)))


def distances(points, path):
    """How far points are from the nearest straight piece of a path."""
    found = np.full(len(points), np.inf)
    for one, other in itertools.pairwise(path):
        way = other - one
        share = np.clip((points - one) @ way / (way @ way), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(points - one - share[:, None] * way, axis=1))
    return found


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.floats(1e-3, 1.0))
def test_a_rounded_path_stays_near_it_and_keeps_its_ends(seed, farthest):
    path = random_path(seed)
    stretches = rounded(path, farthest, lambda chords: True, 1e-4)
    points = np.concatenate([each(np.linspace(0.0, each.length, 500)) for each in stretches])
    np.testing.assert_allclose(points[[0, -1]], path[[0, -1]], atol=1e-12)
    assert distances(points, path).max() <= farthest + 1e-9
    for stretch in stretches:
        middles = (stretch.ends[1:-1:2] + stretch.ends[2:-1:2]) / 2.0
        away = np.linalg.norm(stretch(middles) - stretch.corners[1:-1], axis=1)
        assert np.all(away <= farthest + 1e-9)
    for one, other in itertools.pairwise(stretches):
        np.testing.assert_array_equal(one.corners[-1], other.corners[0])


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_derivatives_are_those_of_the_positions_and_do_not_jump(seed):
    for stretch in rounded(random_path(seed), 0.3, lambda chords: True, 1e-4):
        step, at = 1e-5, np.linspace(1e-4, stretch.length - 1e-4, 301)
        slope = (stretch(at + step) - stretch(at - step)) / (2.0 * step)
        np.testing.assert_allclose(slope, stretch(at, 1), atol=1e-5)
        radius = min([*stretch.radii, 1.0])
        bend = (stretch(at + step, 1) - stretch(at - step, 1)) / (2.0 * step)
        np.testing.assert_allclose(bend, stretch(at, 2), atol=20.0 * step / radius**2)


def test_the_chords_that_are_proven_are_near_the_curve():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    seen = []
    (stretch,) = rounded(path, 0.1, lambda chords: seen.append(chords) is None, 1e-5)
    (chords,) = seen
    _, begin, end, _ = stretch.ends
    assert distances(stretch(np.linspace(begin, end, 5000)), chords).max() <= 1e-5
    assert distances(path[1:2], chords)[0] == pytest.approx(0.1, rel=1e-3)


def test_a_curve_that_is_not_free_is_made_smaller_or_becomes_a_stop():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    (stretch,) = rounded(path, 0.1, lambda chords: distances(path[1:2], chords)[0] < 0.03, 1e-5)
    assert distances(path[1:2], stretch(np.linspace(0.0, 2.0, 2001)))[0] == pytest.approx(0.025, rel=0.01)
    stops = rounded(path, 0.1, lambda chords: False, 1e-5)
    assert [each.corners.tolist() for each in stops] == [path[:2].tolist(), path[1:].tolist()]
    assert [len(each.radii) for each in rounded(path, 0.0, lambda chords: True, 1e-5)] == [0, 0]


def test_a_path_that_turns_back_is_rounded_on_itself():
    path = np.array([[0.0, 0.0], [1.0, 2.0], [0.5, 1.0]])
    (stretch,) = rounded(path, 0.1, lambda chords: True, 1e-5)
    points = stretch(np.linspace(0.0, stretch.length, 1000))
    assert distances(points, path).max() < 1e-12


def test_points_without_a_corner_are_left_out():
    path = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [2.0, 2.0], [2.0, 0.0]])
    assert simplified(path).tolist() == [[0.0, 0.0], [2.0, 2.0], [2.0, 0.0]]
    assert simplified(path[:2]).tolist() == [[0.0, 0.0]]
    assert rounded(path[:2], 0.1, lambda chords: True, 1e-5) == []
