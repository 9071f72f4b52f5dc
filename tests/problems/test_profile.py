"""Profiles of speed along paths: never above their limits, never a jump of velocity, and the path stays what it is."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from problems.motion import Pace
from problems.profile import Profile, ride

size = st.floats(1e-3, 50.0)


def rests_between(path, lengths, places):
    """How far places, (n, 2), are from a polyline."""
    away = np.full(len(places), np.inf)
    for one, other in pairwise(path):
        step = other - one
        share = np.clip((places - one) @ step / max(step @ step, 1e-300), 0.0, 1.0)
        away = np.minimum(away, np.linalg.norm(places - one - share[:, None] * step, axis=1))
    return away


@given(st.lists(st.tuples(size, size, size), min_size=1, max_size=6), st.floats(0.0, 1.0))
def test_a_profile_keeps_its_limits_and_goes_all_the_way(pieces, share):
    lengths, speeds, gains = np.array(pieces).T
    profile = Profile(lengths, speeds, gains)
    inner = np.sort(
        np.concatenate([profile.knots, np.linspace(0.0, profile.ends[-1], 200), [share * profile.ends[-1]]])
    )
    way, speed, piece = profile.at(inner)
    assert way[0] == speed[0] == speed[-1] == 0.0
    assert way[-1] == pytest.approx(lengths.sum(), rel=1e-12)
    assert np.all(speed >= 0.0)
    assert np.all(speed <= speeds[piece])
    steps = np.diff(inner)
    assert np.all(np.abs(np.diff(speed)) <= gains.max() * steps * (1 + 1e-9) + 1e-9)
    scale = 1e-9 * lengths.sum()
    np.testing.assert_allclose(np.diff(way), (speed[1:] + speed[:-1]) / 2 * steps, atol=scale + 1e-9)
    np.testing.assert_allclose(profile.at(profile.ends)[1], 0.0, atol=1e-9)
    quickest = np.where(lengths >= speeds**2 / gains, lengths / speeds + speeds / gains, 2 * np.sqrt(lengths / gains))
    np.testing.assert_allclose(profile.seconds, quickest, rtol=1e-9)
    passed = share * lengths.sum()
    assert profile.at(profile.when(np.array([passed])))[0] == pytest.approx(passed, abs=1e-9)


def test_a_profile_waits_where_its_pieces_begin_late():
    profile = Profile(np.array([1.0, 2.0]), np.ones(2), np.ones(2), np.array([1.0, 5.0]))
    way, speed, _ = profile.at(np.array([0.0, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 9.0]))
    np.testing.assert_allclose(way, [0.0, 0.0, 0.0, 0.5, 1.0, 1.0, 1.0, 1.5, 3.0, 3.0])
    np.testing.assert_allclose(speed, [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0])
    gains, piece = profile.gains(np.array([0.0, 1.0, 2.0, 3.0, 5.0, 6.0, 7.0, 8.0]))
    assert gains.tolist() == [0.0, 1.0, -1.0, 0.0, 1.0, 0.0, -1.0, -1.0]
    assert piece.tolist() == [0, 0, 0, 0, 1, 1, 1, 1]


steps_of_a_path = st.lists(
    st.tuples(st.sampled_from([0.0, 0.0, 0.5, 1.5, 3.0]), st.one_of(st.just(0.0), st.floats(0.01, 5.0))),
    min_size=1,
    max_size=7,
)


@given(steps_of_a_path, st.floats(0.05, 5.0), st.floats(0.05, 20.0), st.floats(5.0, 60.0))
def test_a_ride_stays_on_its_path_and_its_velocity_never_jumps(steps, speed, gain, rate):
    path = np.cumsum([(0.0, 0.0), *((length * np.cos(way), length * np.sin(way)) for way, length in steps)], axis=0)
    lengths = np.array([length for _, length in steps])
    way = ride(path, lengths, np.array(speed), np.array(gain), Pace(rate=rate))
    assert np.all(way.rows[0] == path[0])
    assert np.all(way.rows[-1] == path[-1])
    assert rests_between(path, lengths, way.rows).max() < 1e-9 or len(path) == 1
    assert all(np.linalg.norm(way.rows - corner, axis=1).min() < 1e-8 for corner in path)
    quick = np.linalg.norm(way.velocities, axis=1)
    assert np.all(quick <= speed * (1 + 1e-9))
    assert quick[0] == quick[-1] == 0.0
    assert np.all(np.linalg.norm(way.accelerations, axis=1) <= gain * (1 + 1e-9))
    seconds = np.diff(way.times)[:, None]
    np.testing.assert_allclose(np.diff(way.velocities, axis=0), way.accelerations[:-1] * seconds, atol=1e-6)
    between = (way.velocities[1:] + way.velocities[:-1]) / 2.0
    np.testing.assert_allclose(np.diff(way.rows, axis=0), between * seconds, atol=1e-6)


def test_a_ride_rests_only_where_the_direction_changes():
    path = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [3.0, 0.0], [3.0, 2.0], [3.0, 1.0]])
    lengths = np.array([1.0, 0.0, 2.0, 2.0, 1.0])
    way = ride(path, lengths, np.array(1.0), np.array(2.0), Pace(rate=10.0))
    assert way.stops == 2
    assert way.times[-1] == pytest.approx(6.0 + 3 * 0.5)
    passing = np.argmin(np.abs(way.times - 1.25))  # 1 m on, half a second's ramp behind
    np.testing.assert_allclose(way.velocities[passing], [1.0, 0.0])
    assert way.notes == ("it rests at 2 corners of the path",)


def test_who_stays_where_it_is_needs_no_time():
    for path, lengths in (([[1.0, 2.0]], []), ([[1.0, 2.0], [1.0, 2.0]], [0.0])):
        way = ride(np.array(path), np.array(lengths), np.array(1.0), np.array(1.0), Pace())
        assert way.times.tolist() == [0.0]
        assert way.rows.tolist() == [[1.0, 2.0]]
        assert not way.velocities.any()
        assert way.notes == ()
