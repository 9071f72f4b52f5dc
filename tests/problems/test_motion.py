"""Motions over time: of every kind that has some, from start to goal, by the solution and by the speeds asked for."""

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rooms import EMPTY_ROOM

import supernode
from node.plan import Plan
from node.simulation import simulate
from problems import EvaluationFailed
from problems.file import parse
from problems.guard import moved
from problems.motion import MOST_ROWS, Body, Column, Joints, Motion, Pace, Values
from problems.sphere_path.pose import rotations
from spy.past import best_known

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
TIMED = ("min-time", "coordination")
NAMES = sorted(
    path.name
    for path in EXAMPLES.glob("*.toml")
    if path.stem.split("-")[0] in ("arm", "coordination", "min", "mobile", "sphere", "terrain")
    and not path.stem.startswith("arm-ik")
)


@cache
def solved(name):
    file = supernode.load(EXAMPLES / name)
    best = best_known(simulate(Plan.of(file)), "champion")
    problem = file.problem()
    return problem, json.loads(json.dumps(problem.decode(np.frombuffer(best.genome, np.uint8))))


def moving(name, **pace):
    problem, solution = solved(name)
    if problem.kind not in TIMED:
        pace = {"speed": 0.7} | pace
    return problem, solution, moved(problem, solution, Pace(**pace))


def table(motion):
    return {column.name: column.values for column in motion.columns()}


def made(text):
    return parse(text, "problem", Path()).problem()


# Every kind -----------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("name", NAMES)
def test_times_increase_from_0_and_no_number_is_missing(name):
    _, _, motion = moving(name)
    columns = list(motion.columns())
    assert columns[0][:2] == ("t", "s")
    assert motion.times[0] == 0.0
    assert np.all(np.diff(motion.times) > 0.0)
    assert len({column.name for column in columns}) == len(columns) > 1
    assert all(column.values.shape == motion.times.shape for column in columns)


@pytest.mark.parametrize("name", [name for name in NAMES if not name.startswith(TIMED)])
def test_a_path_is_followed_from_start_to_goal_through_all_its_rows(name):
    _, solution, motion = moving(name, rate=10.0)
    path = np.array(solution["path"], float)
    rows = np.column_stack([column.values for column in list(motion.columns())[1 : 1 + path.shape[1]]])
    np.testing.assert_array_equal(rows[0], path[0])
    np.testing.assert_array_equal(rows[-1], path[-1])
    assert all(np.abs(rows - place).max(axis=1).min() < 1e-9 for place in path)
    limits = {limit.name: limit.values for limit in motion.limits}
    assert limits.get("speed", limits.get("velocity", (0.0,)))[0] == 0.7
    assert limits["acceleration"][0] == pytest.approx(0.7 / 0.5)
    _, _, slower = moving(name, rate=10.0, speed=0.35, acceleration=0.7 / 2)  # time stretched to twice as long
    assert slower.times[-1] == pytest.approx(2.0 * motion.times[-1])


@pytest.mark.parametrize("name", [name for name in NAMES if not name.startswith(TIMED)])
def test_no_velocity_of_a_path_ever_jumps(name):
    """By finite differences of what is exported, ten times as dense as the ramps need."""
    _, solution, motion = moving(name, rate=100.0, acceleration=1.0)
    numbers = np.array(solution["path"], float).shape[1]
    rows = np.column_stack([column.values for column in list(motion.columns())[1 : 1 + numbers]])
    velocities = np.diff(rows, axis=0) / np.diff(motion.times)[:, None]
    middles = (motion.times[1:] + motion.times[:-1]) / 2.0
    assert np.abs(velocities[[0, -1]]).max() <= 0.02 * 1.01
    gains = np.diff(velocities, axis=0) / np.diff(middles)[:, None]
    assert np.abs(gains).max() <= 20.0  # angles of vehicles and robots count by their reach; a jump has thousands


@pytest.mark.parametrize("name", [name for name in NAMES if not name.startswith(TIMED)])
def test_a_path_without_times_needs_a_speed(name):
    problem, solution = solved(name)
    with pytest.raises(supernode.BadInput, match=r"^--speed: expected a speed in .+/s|per second, as a path"):
        moved(problem, solution, Pace())


@pytest.mark.parametrize("name", ["min-time.toml", "coordination.toml"])
def test_a_motion_with_times_takes_no_speed(name):
    problem, solution = solved(name)
    for field in ("speed", "turn_speed", "acceleration", "turn_acceleration"):
        option = "--" + field.replace("_", "-")
        with pytest.raises(supernode.BadInput, match=f"^{option}: expected none for {problem.kind}, which has times"):
            moved(problem, solution, Pace(**{field: 1.0}))


def test_nothing_else_is_a_motion():
    for name in ("arm-ik.toml", "rastrigin.toml", "own_problem.toml"):
        assert supernode.load(EXAMPLES / name).problem().motion({}, Pace()) is None


# Moments --------------------------------------------------------------------------------------------------------------
lengths = st.floats(0.0, 5.0).map(lambda length: length if length > 1e-3 else 0.0)


@given(st.lists(lengths, min_size=1, max_size=8), st.floats(0.1, 200.0))
def test_moments_hold_all_knots_and_leave_no_gap(steps, rate):
    knots = np.concatenate([[0.0], np.cumsum(steps)])
    times = Pace(rate=rate).moments(knots)
    assert set(knots) <= set(times)
    assert (times[0], times[-1]) == (0.0, knots[-1])
    gaps = np.diff(times)
    assert np.all(gaps > 0.0)
    assert gaps.max(initial=0.0) <= 1.2 / rate + 1e-9


def test_what_a_clock_of_nanoseconds_cannot_tell_apart_is_one_moment():
    knots = np.array([0.0, 3e-10, 0.5, 0.5 + 1e-16, 0.5 + 2e-10, 0.7, 0.7 + 1e-12])
    assert Pace(rate=1.0).moments(knots).tolist() == [0.0, 0.5, 0.7 + 1e-12]
    assert Pace(rate=1.0).moments(np.array([0.0, 1e-12])).tolist() == [0.0, 1e-12]


def test_too_many_rows_are_refused():
    for knots, rate in ((1e3, 1e9), (math.inf, 1.0), (1e300, 1e300)):
        with pytest.raises(supernode.BadInput, match=f"^--rate: expected at most {MOST_ROWS:,} rows, found "):
            Pace(rate=rate).moments(np.array([0.0, knots]))


# One kind -------------------------------------------------------------------------------------------------------------
def test_min_time_is_its_trajectory():
    problem, solution, motion = moving("min-time.toml")
    (arm,), rows = motion.tracks, solution["trajectory"]
    np.testing.assert_array_equal(motion.times, rows["t"])
    for name, values in (("q", arm.position), ("qd", arm.velocity), ("qdd", arm.acceleration), ("torque", arm.effort)):
        np.testing.assert_array_equal(values, rows[name])
    np.testing.assert_allclose(arm.position[[0, -1]], [problem.start, problem.goal], atol=1e-9)
    assert list(table(motion))[:3] == ["t", "joint_1.position", "joint_2.position"]
    np.testing.assert_allclose(arm.links[0, -1], [math.cos(-0.5) + math.cos(-1.5), math.sin(-0.5) + math.sin(-1.5), 0])
    assert [str(limit) for limit in motion.limits] == ["torque [64.5, 64.5] N m (arm.torque)"]
    assert motion.notes[0].startswith("between rows the limits hold")
    assert motion.notes[1:] == ("no limit of velocity is stated: arm.velocity",)
    with pytest.raises(supernode.BadInput, match=r"^--rate: expected none for min-time, whose rows"):
        moved(problem, solution, Pace(rate=5.0))


def test_joints_of_a_urdf_keep_their_names():
    pytest.importorskip("pinocchio")
    problem, solution, motion = moving("min-time-panda.toml")
    assert motion.tracks[0].joints == tuple(problem.arm.names)
    assert motion.tracks[0].joints[0] == "panda_joint1"
    limits = {limit.name: limit.values for limit in motion.limits}
    assert limits["velocity"] == (2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61)
    assert np.all(np.abs(motion.tracks[0].velocity) <= np.array(limits["velocity"]) * (1.0 + 1e-6))
    assert motion.times[-1] == solution["time"]


DIAGRAM = """
kind = "coordination"
[diagram]
cells = [40, 25]
times = [[{}, {}], [{}, {}]]
"""
waits = st.lists(st.tuples(st.integers(0, 39), st.integers(0, 24)), max_size=6).map(
    lambda points: [list(each) for each in zip(*(sorted(axis) for axis in zip(*points, strict=True)), strict=True)]
)
quick = st.floats(0.01, 2.0)
ramp = st.floats(0.01, 20.0)


@given(waits, quick, ramp, quick, ramp)
def test_robots_gain_and_lose_speed_evenly_and_meet_where_they_wait(points, cell_1, ramp_1, cell_2, ramp_2):
    problem = made(DIAGRAM.format(cell_1, ramp_1, cell_2, ramp_2))
    solution = {"time": 0.0, "points": points}
    motion = moved(problem, solution, Pace(rate=3.0))
    assert motion.times[-1] == pytest.approx(problem.check(solution).fitness)
    columns = table(motion)
    both = np.column_stack([columns["robot_1.cell"], columns["robot_2.cell"]])
    for place in ((0, 0), *points, problem.last):
        assert np.abs(both - place).max(axis=1).min() < 1e-6
    np.testing.assert_array_equal(both[[0, -1]], [(0, 0), problem.last])
    for robot, to_speed, per_cell in (("robot_1", ramp_1, cell_1), ("robot_2", ramp_2, cell_2)):
        cells, speeds = columns[f"{robot}.cell"], columns[f"{robot}.speed"]
        assert np.all(np.diff(cells) >= -1e-9)
        assert speeds.max() <= (1.0 + 1e-9) / per_cell
        steps = np.diff(motion.times)
        np.testing.assert_allclose(np.diff(cells), steps * (speeds[:-1] + speeds[1:]) / 2.0, atol=1e-6)
        assert np.all(np.abs(np.diff(speeds)) <= steps / (per_cell * to_speed) + 1e-6)


@pytest.mark.parametrize("times", [(0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 1.0, 1.0), (1.0, 1.0, 1.0, 0.0)])
def test_robots_whose_speed_would_jump_have_no_motion(times):
    number = 1 if times[0] == 0.0 else 2
    with pytest.raises(supernode.BadInput, match=f"^the times of robot {number}: expected more than 0 s for a cell"):
        moved(made(DIAGRAM.format(*times)), {"time": 0.0, "points": []}, Pace())


def test_arms_follow_their_paths_within_their_speeds():
    problem, solution, motion = moving("coordination-arms.toml", rate=200.0)
    (note,) = motion.notes
    assert note.startswith(
        f"it takes {motion.times[-1] - solution['time']:.4g} s longer than the plan, as the arms rest"
    )
    for robot, track in zip(problem.robots, motion.tracks, strict=True):
        np.testing.assert_allclose(track.position[[0, -1]], [robot.path[0], robot.path[-1]], atol=1e-9)
        assert np.all(np.abs(track.velocity) <= np.array(robot.speeds) * (1.0 + 1e-9))
        seconds = np.diff(motion.times)[:, None]
        between = (track.velocity[:-1] + track.velocity[1:]) / 2.0
        np.testing.assert_allclose(np.diff(track.position, axis=0), between * seconds, atol=1e-7)
        np.testing.assert_allclose(np.diff(track.velocity, axis=0), track.acceleration[:-1] * seconds, atol=1e-6)
        np.testing.assert_allclose(track.links[:, 0], np.tile(robot.base[:3], (len(motion.times), 1)))


@pytest.mark.parametrize("robot", ["vertices = [[-0.2, -0.2], [0.5, 0.0], [-0.2, 0.2]]", "radius = 0.5"])
def test_a_robot_that_turns_is_nowhere_quicker_than_its_speed(robot):
    problem = made(EMPTY_ROOM + robot)
    solution = {"commands": [], "path": [[1, 1, 0], [3, 1, 0], [3, 1, 1.5]], "length": 2}
    motion = moved(problem, solution, Pace(speed=0.5, rate=10.0))
    ramp = 0.5  # s, by default, of the move and of the turn
    assert motion.times[-1] == pytest.approx(4.0 + ramp + 1.5 * 0.5 / 0.5 + ramp)
    told = moved(
        problem, solution, Pace(speed=0.5, turn_speed=3.0, acceleration=1.0, turn_acceleration=30.0, rate=10.0)
    )
    assert told.times[-1] == pytest.approx(4.0 + 0.5 + 0.5 + 0.1)
    assert [str(limit) for limit in told.limits] == [
        "speed 0.5 m/s (--speed)",
        "acceleration 1 m/s^2 (--acceleration)",
        "turn speed 3 rad/s (--turn-speed)",
        "turn acceleration 30 rad/s^2 (--turn-acceleration)",
    ]
    (body,) = motion.tracks
    np.testing.assert_array_equal(body.angles[-1], [0.0, 0.0, 1.5])
    assert np.linalg.norm(body.outline, axis=1).max() == pytest.approx(0.5)
    assert len(motion.obstacles) == 1


def test_a_terrain_robot_heads_where_it_goes():
    problem = made('kind = "terrain"\nstart = [2, 0]\ngoal = [0, 2]\nmap = ["...", "...", "..."]\nrobot_radius = 0.2')
    solution = {
        "path": [[2, 0], [1, 1], [0, 1], [0, 2]],
        "cost": 0.0,
        "moves": [[math.pi / 4, 1], [math.pi / 2, 1], [0, 1]],
    }
    motion = moved(problem, solution, Pace(speed=2.0, rate=20.0))
    (body,) = motion.tracks
    steps, turns = np.diff(body.places, axis=0), np.diff(body.angles[:, 2])
    moves = np.linalg.norm(steps, axis=1) > 1e-9
    np.testing.assert_allclose(np.arctan2(steps[moves, 1], steps[moves, 0]), body.angles[:-1][moves, 2], atol=1e-9)
    assert np.all(np.abs(turns[moves]) < 1e-12)
    gain, turn_gain = 2.0 / 0.5, 2.0 / 0.2 / 0.5  # by default; its rim is as quick as the robot
    moved_on = [math.sqrt(2.0) / 2.0 + 0.5, 2 * math.sqrt(1.0 / gain), 2 * math.sqrt(1.0 / gain)]  # two are triangles
    turned = [2 * math.sqrt(angle / turn_gain) for angle in (math.pi / 4, math.pi / 2)]
    assert motion.times[-1] == pytest.approx(sum(moved_on) + sum(turned))
    alone = moved(problem, {"path": [[2, 0]], "cost": 0.0, "moves": []}, Pace(speed=2.0))
    assert alone.times.tolist() == [0.0]


def test_a_vehicle_turns_by_its_angles_and_arcs_count_as_lengths():
    problem, solution, motion = moving("sphere-path-vehicle.toml")
    assert list(table(motion)) == ["t", "x", "y", "heading"]
    arcs = np.linalg.norm(np.diff(np.array(solution["path"]), axis=0) * problem.space.scale, axis=1)
    assert arcs.sum() == pytest.approx(solution["length"])
    _, _, slow = moving("sphere-path-vehicle.toml", turn_speed=0.1, turn_acceleration=0.05, rate=200.0)
    turning = np.diff(table(slow)["heading"]) / np.diff(slow.times)
    assert np.abs(turning).max() == pytest.approx(0.1, rel=1e-3)
    assert slow.times[-1] > motion.times[-1]
    (body,) = motion.tracks
    assert isinstance(body, Body)
    assert len(motion.obstacles) == len(problem.obstacles)
    turned = rotations(body.angles[:, 2:], 2)
    np.testing.assert_allclose(turned[:, 1, 0], np.sin(table(motion)["heading"]))


def test_a_place_among_spheres_is_just_numbers():
    _, _, motion = moving("sphere-path.toml")
    (track,) = motion.tracks
    assert isinstance(track, Values)
    assert [column[:2] for column in track.columns] == [("axis_1", ""), ("axis_2", ""), ("axis_3", "")]


def test_an_arm_path_turns_one_joint_after_another():
    problem, _, motion = moving("arm-path.toml", speed=0.5, rate=30.0)
    (arm,) = motion.tracks
    assert isinstance(arm, Joints)
    turned = np.abs(np.diff(arm.position, axis=0))
    assert np.all(np.count_nonzero(turned > 1e-9, axis=1) <= 1)
    assert np.abs(arm.velocity).max() == pytest.approx(0.5)
    assert np.abs(arm.acceleration).max() == pytest.approx(0.5 / 0.5)
    reach = np.linalg.norm(np.diff(arm.links, axis=1), axis=2)
    np.testing.assert_allclose(reach, np.tile(problem.arm.links, (len(reach), 1)))
    assert len(motion.obstacles) == len(problem.obstacles)


def slow_arm(**limits):
    lines = "\n".join(f"{name} = {values}" for name, values in limits.items())
    return made(f'kind = "arm-path"\nstart = [0.0, 0.0]\ngoal = [2.0, 1.0]\n[arm]\nlinks = [1.0, 0.8]\n{lines}')


def test_an_arm_keeps_to_its_own_limits_and_to_those_of_the_command_line():
    solution = {"path": [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0]]}
    problem = slow_arm(velocity=[0.5, 2.0], acceleration=[1.0, 8.0])
    motion = moved(problem, solution, Pace(rate=100.0))
    (arm,) = motion.tracks
    np.testing.assert_allclose(np.abs(arm.velocity).max(axis=0), [0.5, 2.0])
    np.testing.assert_allclose(np.abs(arm.acceleration).max(axis=0), [1.0, 8.0])
    assert motion.times[-1] == pytest.approx(2.0 / 0.5 + 0.5 / 1.0 + 1.0 / 2.0 + 2.0 / 8.0)
    slower = moved(problem, solution, Pace(speed=1.0, acceleration=0.8))
    assert [str(limit) for limit in slower.limits] == [
        "velocity [0.5, 1] rad/s (--speed and arm.velocity)",
        "acceleration [0.8, 0.8] rad/s^2 (--acceleration and arm.acceleration)",
    ]
    with pytest.raises(supernode.BadInput, match=r"^--speed: expected a speed in rad/s, .* and its arm no `velocity`"):
        moved(slow_arm(), solution, Pace())
    with pytest.raises(supernode.BadInput, match=r"arm: velocity: expected one limit for each of 2 joints, found 1"):
        slow_arm(velocity=[0.5])


# A user's own ---------------------------------------------------------------------------------------------------------
def test_a_motion_that_is_none_is_one_error():
    def motion(times, values):
        return Motion(np.array(times), (Values("", (Column("x", "m", np.array(values)),)),))

    class Own:
        kind = "own"

        def __init__(self, answer):
            self.answer = answer

        def motion(self, solution, pace):
            return self.answer(solution)

    assert moved(Own(lambda _: motion([0.0, 1.0], [2.0, 3.0])), {}, Pace()).times[-1] == 1.0
    for wrong in (
        lambda _: 3,
        lambda solution: solution["nothing"],
        lambda _: motion([0.0, 0.0], [2.0, 3.0]),
        lambda _: motion([0.0, 1.0], [2.0, math.nan]),
        lambda _: motion([0.0, 1.0], [2.0]),
        lambda _: motion([], []),
    ):
        with pytest.raises(EvaluationFailed, match=r"^own: motion "):
            moved(Own(wrong), {}, Pace())
