"""Motions over time of real robots: quick, and within all limits, which pinocchio itself measures here."""

from pathlib import Path

import numpy as np
import pinocchio
import pytest
from heavy_robots import JOINTS, PATH, arm, arm_urdf
from hypothesis import given, settings
from hypothesis import strategies as st

from problems import BadInput
from problems.motion import Pace
from problems.robots import trajectory
from problems.robots.dynamics import GRAVITY, Dynamics
from problems.robots.fields import Robot
from problems.robots.limits import limits_of, own_limits
from problems.robots.loading import gather_description
from problems.robots.retiming import retime
from problems.robots.trajectory import Trajectory


def always(chords):
    return True


def timed(robot, joints, path, pace=None, is_free=always):
    pace = pace or Pace()
    limits = limits_of(robot, joints, pace)
    return retime(np.array(path), limits, Dynamics.of(robot, joints), pace, is_free)


def between(rows, count=5):
    """Positions, velocities and accelerations of the cubics between rows, also at both of their ends."""
    found = [[], [], []]
    for row, step in enumerate(np.diff(rows.times)):
        (a, b), (v, w) = rows.positions[row : row + 2], rows.velocities[row : row + 2]
        u = np.linspace(0.0, 1.0, count)[:, None]
        second, third = 3.0 * (b - a) - step * (2.0 * v + w), 2.0 * (a - b) + step * (v + w)
        found[0].append(a + step * v * u + second * u**2 + third * u**3)
        found[1].append(v + (2.0 * second * u + 3.0 * third * u**2) / step)
        found[2].append((2.0 * second + 6.0 * third * u) / step**2)
    return [np.concatenate(each) for each in found]


def torques_of(model, place, samples):
    """By pinocchio; ``place`` maps a configuration of ours to the model's."""
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *map(place, each)) for each in zip(*samples, strict=True)])


@pytest.fixture(scope="module")
def panda():
    names = [f"panda_joint{number}" for number in range(1, 8)]
    return Robot(**gather_description({"urdf": "example-robot-data:panda", "joints": names}, Path())), names


@pytest.mark.parametrize(("gain", "blend"), [(None, None), (25.0, 0.3), (25.0, 0.0)])
def test_no_sample_of_the_pandas_motion_is_beyond_a_limit(panda, gain, blend):
    robot, names = panda
    path = np.array(
        [
            [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
            [0.6, 0.1, 0.2, -1.9, 0.1, 2.1, 0.5],
            [1.4, 0.5, -0.3, -1.2, -0.4, 1.6, 0.9],
            [0.9, 0.9, 0.4, -1.5, 0.3, 2.4, 0.2],
        ]
    )
    rows = timed(robot, names, path, Pace(acceleration=gain, blend=blend))
    whole = pinocchio.buildModelFromXML(robot.urdf)
    fingers = [whole.getJointId(name) for name in whole.names if "finger" in name]
    model = pinocchio.buildReducedModel(whole, fingers, pinocchio.neutral(whole))
    assert list(model.names)[1:] == names
    q, qd, qdd = between(rows)
    needed = np.abs(torques_of(model, np.asarray, (q, qd, qdd))) / model.effortLimit
    speed = np.abs(qd) / model.velocityLimit
    most = model.velocityLimit / 0.5 if gain is None else np.full(7, gain)
    shares = [needed.max(), speed.max(), (np.abs(qdd) / most).max()]
    assert max(shares) < 1.01
    assert max(shares) > 0.97  # as quick as something allows
    if gain is not None:
        assert shares[0] > 0.9  # torques are what limits this motion
    np.testing.assert_array_equal(rows.positions[[0, -1]], path[[0, -1]])
    assert (rows.stops, rows.curves) == ((2, 0) if blend == 0.0 else (0, 2))
    assert np.allclose(
        rows.torques, torques_of(model, np.asarray, (rows.positions, rows.velocities, rows.accelerations))
    )
    seen = []
    found = trajectory.objections_to(
        Trajectory(**rows.plain()), path, robot, names, lambda chords, room: seen.append(len(chords)) or ()
    )
    assert found == ()
    assert seen[0] >= len(rows.times)


def test_rounded_corners_save_time():
    robot = arm()
    seconds = [timed(robot, JOINTS, PATH, Pace(blend=blend)).times[-1] for blend in (0.0, 0.05, 0.2)]
    assert seconds[0] > 1.05 * seconds[1] > 1.05 * seconds[2]
    assert timed(robot, JOINTS, PATH, is_free=lambda chords: False).times[-1] == pytest.approx(seconds[0])


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(*[st.floats(-1.5, 1.5)] * 3), min_size=2, max_size=5), st.sampled_from([0.0, 0.1, 0.5]))
def test_any_path_takes_times_that_begin_and_end_where_it_does(path, blend):
    rows = timed(arm(), JOINTS, path, Pace(blend=blend))
    assert np.all(np.diff(rows.times) > 0.0)
    np.testing.assert_allclose(rows.positions[[0, -1]], np.array(path)[[0, -1]], atol=1e-8)


def test_a_straight_way_takes_the_time_of_the_trapezoid():
    robot = arm(acceleration=[4.0, 4.0, 4.0], mass=0.0)
    rows = timed(robot, JOINTS, [[0.0, 0.0, 0.0], [0.0, 2.0, 1.0]])
    assert rows.torques is None
    assert rows.times[-1] == pytest.approx(2.0 / 2.0 + 2.0 / 4.0, rel=2e-3)


def test_sliding_joints_and_mimics_have_their_part_in_the_torques():
    """The fingers are open by 0.3 m and 0.31 m; their weight is part of the elbow's torque."""
    robot = arm((*JOINTS, "grip"))
    dynamics = Dynamics.of(robot, (*JOINTS, "grip"))
    found = dynamics.torques(np.array([0.2, 0.0, 0.0, 0.3]), np.zeros(4), np.zeros(4))
    elbow = -GRAVITY * (0.5 + 2 * 0.1 * 1.05)
    assert found == pytest.approx([0.0, elbow - GRAVITY * (0.5 + 1.0 + 0.2), elbow, 0.0], abs=1e-9)
    push = dynamics.torques(np.array([0.2, 0.0, 0.0, 0.3]), np.zeros(4), np.array([0.0, 0.0, 0.0, 2.0]))
    assert push[3] == pytest.approx(2.0 * (0.1 + 0.1))
    whole = dynamics.torques(np.zeros(4), np.zeros(4), np.array([3.0, 0.0, 0.0, 0.0]))
    assert whole[0] == pytest.approx(3.0 * 3.2)


def test_gravity_follows_the_base():
    half = np.sqrt(0.5)
    tilted = arm(base={"quaternion": [0.0, half, 0.0, half]})  # x of the robot points down
    dynamics = Dynamics.of(tilted, JOINTS)
    assert dynamics.torques(np.zeros(3), np.zeros(3), np.zeros(3)) == pytest.approx([-3.2 * GRAVITY, 0, 0], abs=1e-6)


def test_joints_that_stand_still_are_where_the_file_says():
    """With the elbow bent by 90° and fixed, only its own mass is off the axis of the shoulder by 1 m."""
    robot = arm(("slide", "shoulder"), fixed={"elbow": -np.pi / 2})
    found = Dynamics.of(robot, ("slide", "shoulder")).torques(np.zeros(2), np.zeros(2), np.zeros(2))
    assert found[1] == pytest.approx(-GRAVITY * (0.5 + 1.0 + 0.2), abs=0.05)


def test_a_continuous_joint_turns_without_end():
    text = arm_urdf().replace('name="elbow" type="revolute"', 'name="elbow" type="continuous"')
    turned = Dynamics.of(Robot(urdf=text, joints=list(JOINTS)), JOINTS)
    plain = Dynamics.of(arm(), JOINTS)
    moments = np.array([[0.1, 0.2, 0.7], [0.5, -0.4, 0.3], [1.0, 2.0, -1.0]])
    assert turned.torques(*moments) == pytest.approx(plain.torques(*moments))
    assert turned.torques(moments[0] + [0, 0, 2 * np.pi], *moments[1:]) == pytest.approx(plain.torques(*moments))


def test_a_robot_that_cannot_hold_itself_is_refused():
    with pytest.raises(
        BadInput, match=r"found one where 'shoulder' needs 2\d\.\d+ N m at rest, more than its effort of 20 N m"
    ):
        timed(arm(effort=20.0), JOINTS, [[0.0, 1.5, 0.0], [0.0, 0.0, 0.0]])


def test_a_path_that_goes_nowhere_takes_no_time():
    rows = timed(arm(), JOINTS, [PATH[0], PATH[0]])
    assert (rows.times.tolist(), rows.positions.tolist()) == ([0.0], [PATH[0]])
    assert trajectory.objections_to(Trajectory(**rows.plain()), [PATH[0]] * 2, arm(), JOINTS, lambda *_: ()) == ()


def test_limits_are_the_least_of_robot_and_options():
    limits = limits_of(arm(acceleration=3.0), JOINTS, Pace(speed=1.5, acceleration=5.0))
    assert limits.velocity.tolist() == [1.0, 1.5, 1.5]
    assert limits.acceleration.tolist() == [3.0, 3.0, 3.0]
    assert limits.sources == ("URDF and --speed", "robot.acceleration and --acceleration", "URDF")
    default = limits_of(arm(), JOINTS, Pace())
    assert default.acceleration.tolist() == [2.0, 4.0, 4.0]
    assert [str(each) for each in default.stated()][1:] == [
        "acceleration [2, 4, 4] rad or m/s^2 (default: full speed after 0.5 s)",
        "torque [300, 60, 30] N m or N (URDF)",
    ]
    assert own_limits(arm(), JOINTS).acceleration.tolist() == [np.inf] * 3
    with pytest.raises(BadInput, match=r"robot.acceleration: expected one value, or 3 \(slide, .*\), found 2"):
        own_limits(arm(acceleration=[1.0, 2.0]), JOINTS)
    bare = Robot(urdf=arm_urdf().replace('velocity="1.0"', ""), joints=list(JOINTS))
    with pytest.raises(BadInput, match=r"--speed: expected a speed in m/s, as the URDF states no velocity of 'slide'"):
        limits_of(bare, JOINTS, Pace())
    assert limits_of(bare, JOINTS, Pace(speed=0.5)).velocity.tolist() == [0.5] * 3


# The check ------------------------------------------------------------------------------------------------------------
@pytest.fixture(scope="module")
def good():
    return timed(arm(acceleration=4.0), JOINTS, PATH).plain()


def objections(found, proven=lambda chords, room: ()):
    return trajectory.objections_to(Trajectory(**found), PATH, arm(acceleration=4.0), JOINTS, proven)


def changed(table, row, by):
    table = np.array(table)
    table[row] += by
    return table.tolist()


def test_a_good_trajectory_has_no_objections(good):
    assert objections(good) == ()
    assert objections({name: each for name, each in good.items() if name != "torque"}) == ()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda g: {"t": [0.98 * each for each in g["t"]]}, "acceleration of "),
        (lambda g: {"t": [1.1 * each for each in g["t"]]}, "the trajectory's qdd differs by "),
        (lambda g: {"t": [1.0 + each for each in g["t"]]}, "times do not increase from 0"),
        (lambda g: {"t": [0.0, *g["t"][:-1]]}, "times do not increase from 0"),
        (lambda g: {"q": changed(g["q"], 0, 1e-3)}, "the trajectory starts 0.001 from where the path does"),
        (lambda g: {"q": changed(g["q"], -1, 1e-3)}, "the trajectory ends 0.001 from where the path does"),
        (lambda g: {"q": changed(g["q"], 20, 0.1)}, "the trajectory's velocity of "),
        (lambda g: {"q": changed(g["q"], slice(20, 30), 4.0)}, "the trajectory leaves a joint's range by "),
        (lambda g: {"qd": changed(g["qd"], -1, 0.5)}, "the trajectory ends with a velocity of 0.5, not at rest"),
        (lambda g: {"qdd": changed(g["qdd"], 30, 0.5)}, "the trajectory's qdd differs by "),
        (lambda g: {"torque": changed(g["torque"], 30, 1.0)}, "the trajectory states torques that are 1 N m from"),
    ],
)
def test_a_spoiled_trajectory_is_rejected(good, change, said):
    assert any(said in each for each in objections(good | change(good)))


def test_torques_beyond_the_limit_are_rejected(good):
    weak = arm(effort=28.0)
    found = trajectory.objections_to(Trajectory(**good), PATH, weak, JOINTS, lambda chords, room: ())
    assert any("times its limit" in each and "torque" in each for each in found)


def test_rows_of_a_wrong_shape_are_bad_input(good):
    with pytest.raises(BadInput, match=r"solution: trajectory.qd: expected \d+ rows of 3 values, found others"):
        objections(good | {"qd": good["qd"][:-1]})


def test_the_way_between_rows_is_proven_with_some_room(good):
    def proven(chords, room):
        assert room == trajectory.ROOM
        assert np.array(chords).shape[0] >= len(good["t"])
        return ("upper touches wall",)

    assert objections(good, proven) == ("the trajectory: upper touches wall",)


def test_chords_are_near_the_cubics():
    rng = np.random.default_rng(4)
    times, q, qd = np.cumsum(rng.uniform(0.1, 0.5, 6)), rng.normal(size=(6, 3)), rng.normal(size=(6, 3))
    chords = np.array(trajectory.chords(times, q, qd, 1e-3))
    rows = heavy_rows(times, q, qd)
    for point in between(rows, 200)[0]:
        assert near(point, chords) < 1e-3
    for point in q:
        assert near(point, chords) < 1e-12


def heavy_rows(times, q, qd):
    class Rows:
        pass

    rows = Rows()
    rows.times, rows.positions, rows.velocities = times, q, qd
    return rows


def near(point, chords):
    one, way = chords[:-1], np.diff(chords, axis=0)
    share = np.clip(((point - one) * way).sum(axis=1) / (way**2).sum(axis=1), 0.0, 1.0)
    return np.linalg.norm(point - one - share[:, None] * way, axis=1).min()


def test_the_reach_bounds_how_far_any_corner_moves():
    robot = arm()
    model = pinocchio.buildModelFromXML(robot.urdf)
    data, rng = model.createData(), np.random.default_rng(2)
    bound = trajectory.reach_of(robot, 3)
    tip = model.getFrameId("lower")
    for _ in range(50):
        q = np.zeros(model.nq)
        q[:3] = rng.uniform(-3.0, 3.0, 3)
        jacobian = pinocchio.computeFrameJacobian(model, data, q, tip, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
        assert np.linalg.norm(jacobian[:, :3], 2) <= bound
