"""Exported motions of robots from URDFs: each file read back, and the command that retimes paths."""

import csv
import io
import json
from dataclasses import dataclass, replace

import numpy as np
import pinocchio
import pytest
from command_line import in_process
from heavy_robots import JOINTS, PATH, arm, arm_urdf
from mcap.reader import make_reader
from mcap_files import read
from scipy.spatial.transform import Rotation

from problems import BadInput, load
from problems.motion import Joints, Motion, Pace, Values
from problems.robots import scenery
from problems.robots.dynamics import Dynamics
from problems.robots.fields import AttachedSphere, BoxObstacle, CylinderObstacle
from problems.robots.limits import limits_of
from problems.robots.retiming import retime
from supernode.motion import ros, text
from supernode.motion.mcap_file import as_mcap
from supernode.terminal import present

HALF = float(np.sqrt(0.5))
ROBOT = arm(fixed={"grip": 0.02}, base={"position": [0.1, 0.2, 0.3], "quaternion": [0.0, 0.0, HALF, HALF]})
SHELF = BoxObstacle(id="shelf", shape="box", size=(0.2, 0.3, 0.4), position=(1.0, 2.0, 3.0))
POST = CylinderObstacle(shape="cylinder", radius=0.1, length=2.0, quaternion=(HALF, 0.0, 0.0, HALF))
BALL = AttachedSphere(id="ball", link="lower", shape="sphere", radius=0.05, position=(1.0, 0.0, 0.0))


@pytest.fixture(scope="module")
def motion():
    limits = limits_of(ROBOT, JOINTS, Pace())
    rows = retime(np.array(PATH), limits, Dynamics.of(ROBOT, JOINTS), Pace(), lambda chords: True)
    known = (rows.times, rows.positions, rows.velocities, rows.accelerations, rows.torques)
    times, *few = (each[::12] for each in known)  # schemas are tested message by message, which takes long
    track = Joints(
        "",
        JOINTS,
        *few,
        units=limits.units,
        urdf=ROBOT.urdf,
        standing=scenery.standing_joints(ROBOT, JOINTS),
    )
    frames = scenery.frames_over_time(ROBOT, JOINTS, track.position)
    return Motion(times, (track,), (), (), (), frames, scenery.solids_of(ROBOT, [SHELF, POST], [BALL]))


@pytest.fixture(scope="module")
def messages(motion):
    return read(as_mcap(motion))


def test_csv_says_which_joints_slide(motion):
    names, *rows = csv.reader(io.StringIO(text.as_csv(motion)))
    assert names[:4] == ["t [s]", "slide.position [m]", "shoulder.position [rad]", "elbow.position [rad]"]
    assert names[4::3] == ["slide.velocity [m/s]", "slide.acceleration [m/s^2]", "slide.effort [N]"]
    assert names[12] == "elbow.effort [N m]"
    np.testing.assert_array_equal(np.array(rows, float)[:, 1:4], motion.tracks[0].position)
    table = json.loads(text.as_json(motion, "robot-path"))
    assert table["units"][:5] == ["s", "m", "rad", "rad", "m/s"]


def test_ros_reads_a_joint_trajectory(motion):
    message = json.loads(ros.as_joint_trajectory(motion))
    track = motion.tracks[0]
    assert message["joint_names"] == list(JOINTS)
    assert message["header"] == {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}
    points = message["points"]
    assert all(
        list(each) == ["positions", "velocities", "accelerations", "effort", "time_from_start"] for each in points
    )
    np.testing.assert_array_equal([each["positions"] for each in points], track.position)
    np.testing.assert_array_equal([each["velocities"] for each in points], track.velocity)
    assert not any(each["accelerations"] or each["effort"] for each in points)
    times = [each["time_from_start"]["sec"] + 1e-9 * each["time_from_start"]["nanosec"] for each in points]
    np.testing.assert_allclose(times, motion.times, atol=1e-9)
    assert np.all(np.diff(times) > 0.0)


def test_ros_reads_two_arms_as_one_but_nothing_else():
    one = Joints("left", ("hip",), np.array([[1.0], [2.0]]))
    message = json.loads(ros.as_joint_trajectory(Motion(np.array([0.0, 1.5]), (one, replace(one, name="right")))))
    assert message["joint_names"] == ["left.hip", "right.hip"]
    assert message["points"][1] == {
        "positions": [2.0, 2.0],
        "velocities": [],
        "accelerations": [],
        "effort": [],
        "time_from_start": {"sec": 1, "nanosec": 500_000_000},
    }
    with pytest.raises(BadInput, match="--format: expected csv, json or mcap, as not only joints move"):
        ros.as_joint_trajectory(Motion(np.zeros(1), (one, Values("v", ()))))


def test_mcap_holds_joint_states_and_the_description(motion, messages):
    found, track = messages, motion.tracks[0]
    ((_, description),) = found["/robot_description", "std_msgs/msg/String"]
    assert description["data"] == ROBOT.urdf
    (attachment,) = make_reader(io.BytesIO(as_mcap(motion))).iter_attachments()
    assert (attachment.name, attachment.media_type) == ("robot.urdf", "application/xml")
    assert attachment.data.decode() == ROBOT.urdf
    states = found["/joint_states", "sensor_msgs/msg/JointState"]
    assert [time for time, _ in states] == [round(each * 1e9) for each in motion.times]
    for row, (time, state) in enumerate(states):
        assert state["header"]["stamp"]["sec"] * 10**9 + state["header"]["stamp"]["nanosec"] == time
        assert state["name"] == [*JOINTS, "grip"]
        assert state["position"] == [*track.position[row].tolist(), 0.02]
        assert state["velocity"] == [*track.velocity[row].tolist(), 0.0]
        assert state["effort"] == [*track.effort[row].tolist(), 0.0]
    assert len(found["/joints", "foxglove.JointStates"]) == len(states)


def test_mcap_holds_the_frames_of_all_links(motion, messages):
    """Where pinocchio says that they are, at the first row and later."""
    messages = messages["/tf", "foxglove.FrameTransforms"]
    model = pinocchio.buildModelFromXML(ROBOT.urdf)
    data, known = model.createData(), {}
    base = pinocchio.SE3(ROBOT.base.placement.reshape(3, 4)[:, :3], np.array(ROBOT.base.position))
    for row, (_, message) in enumerate(messages):
        known |= {each["child_frame_id"]: each for each in message["transforms"]}
        q = np.array([*motion.tracks[0].position[row], 0.03, 0.02])  # pinocchio sorts the fingers by their names
        pinocchio.framesForwardKinematics(model, data, q)
        for link in ("carriage", "upper", "lower", "left", "right"):
            expected = base * data.oMf[model.getFrameId(link)]
            np.testing.assert_allclose(in_world(known, link), expected.homogeneous, atol=1e-9)
    assert len(messages[0][1]["transforms"]) == 6
    assert len(messages[1][1]["transforms"]) == 3  # those that move in their parents


def in_world(known, link):
    pose = np.eye(4)
    while link != "world":
        frame = known[link]
        step = np.eye(4)
        step[:3, :3] = Rotation.from_quat(list(frame["rotation"].values())).as_matrix()
        step[:3, 3] = list(frame["translation"].values())
        pose, link = step @ pose, frame["parent_frame_id"]
    return pose


def test_mcap_holds_the_shapes_of_robot_and_obstacles(messages):
    ((_, scene),) = messages["/shapes", "foxglove.SceneUpdate"]
    entities = {each["id"]: each for each in scene["entities"]}
    assert list(entities) == ["carriage", "upper", "lower", "left", "right", "ball", "shelf", "obstacles[1]"]
    (upper,) = entities["upper"]["cubes"]
    assert entities["upper"]["frame_id"] == "upper"
    assert upper["pose"]["position"] == {"x": 0.5, "y": 0.0, "z": 0.0}
    assert upper["size"] == {"x": 0.4, "y": 0.05, "z": 0.05}
    (ball,) = entities["ball"]["spheres"]
    assert (entities["ball"]["frame_id"], ball["size"]) == ("lower", {"x": 0.1, "y": 0.1, "z": 0.1})
    (post,) = entities["obstacles[1]"]["cylinders"]
    assert (entities["obstacles[1]"]["frame_id"], post["size"]) == ("world", {"x": 0.2, "y": 0.2, "z": 2.0})
    assert post["pose"]["orientation"] == pytest.approx({"x": HALF, "y": 0.0, "z": 0.0, "w": HALF})


@pytest.mark.parametrize("turn", [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0.5, -0.5, 0.5, 0.5]])
def test_quaternions_are_found_at_half_turns_too(turn):
    found = scenery.quaternion_of(Rotation.from_quat(turn).as_matrix())
    assert abs(found @ np.array(turn, float)) == pytest.approx(1.0)


# The command ----------------------------------------------------------------------------------------------------------
FILE = """
kind = "robot-path"
start = [0.0, -0.5, 0.3]
goal = [0.4, -0.8, -0.9]
[robot]
urdf = "arm.urdf"
joints = ["slide", "shoulder", "elbow"]
acceleration = 5.0
[[obstacles]]
shape = "sphere"
radius = 0.1
position = [3.0, 0.0, 3.0]
"""
SOLUTION = {"path": [[0.0, -0.5, 0.3], [0.5, -0.2, -0.5], [0.4, -0.8, -0.9]], "clearance": 0.0}
SOLUTION["length"] = float(np.linalg.norm(np.diff(SOLUTION["path"], axis=0), axis=1).sum())


@pytest.fixture
def export(tmp_path, capsys):
    (tmp_path / "arm.urdf").write_text(arm_urdf())
    (tmp_path / "problem.toml").write_text(FILE)

    def run(result, *options):
        (tmp_path / "result.json").write_text(json.dumps(result))
        return in_process(capsys, "export", tmp_path / "problem.toml", tmp_path / "result.json", *options)

    return run


def test_the_command_retimes_a_path(export, tmp_path):
    code, out, err = export(SOLUTION, "--retime", "--format", "ros")
    assert (code, err.splitlines()) == (
        0,
        [
            "limit: velocity [1, 2, 2] rad or m/s (URDF)",
            "limit: acceleration [5, 5, 5] rad or m/s^2 (robot.acceleration)",
            "limit: torque [300, 60, 30] N m or N (URDF)",
            "note: between two rows it is the cubic that has their positions and velocities",
        ],
    )
    message = json.loads(out)
    assert message["joint_names"] == list(JOINTS)
    ends = [message["points"][row]["positions"] for row in (0, -1)]
    assert ends == [SOLUTION["path"][0], SOLUTION["path"][-1]]
    assert SOLUTION["path"][1] not in [each["positions"] for each in message["points"]]
    code, _, err = export(SOLUTION, "--retime", "--blend", 0, "-o", tmp_path / "motion.mcap")
    assert (code, err.splitlines()[-1]) == (0, "note: it rests at 1 corner of the path")
    channels = make_reader(io.BytesIO((tmp_path / "motion.mcap").read_bytes())).get_summary().channels
    topics = {each.topic for each in channels.values()}
    assert topics == {"/joints", "/joint_states", "/robot_description", "/shapes", "/tf"}


def test_a_trajectory_of_a_solution_is_checked_and_exported_as_it_is(export):
    rows = retimed_rows()
    code, out, _ = export(SOLUTION | {"trajectory": rows}, "--format", "json")
    table = json.loads(out)
    assert (code, [row[:4] for row in table["rows"]]) == (
        0,
        [[t, *q] for t, q in zip(rows["t"], rows["q"], strict=True)],
    )
    code, _, err = export(SOLUTION | {"trajectory": rows}, "--rate", 10)
    assert (code, err.splitlines()) == (
        2,
        ["error: --rate: expected none for robot-path, whose trajectory has times of its own, found 10"],
    )
    hasty = rows | {"t": [0.9 * each for each in rows["t"]]}
    code, _, err = export(SOLUTION | {"trajectory": hasty}, "--format", "json")
    assert code == 3
    assert err.startswith("rejected: the trajectory's ")


def retimed_rows():
    robot = arm(acceleration=5.0)
    limits = limits_of(robot, JOINTS, Pace())
    dynamics = Dynamics.of(robot, JOINTS)
    return retime(np.array(SOLUTION["path"]), limits, dynamics, Pace(), lambda chords: True).plain()


@dataclass(frozen=True)
class Found:
    """What `solve --retime` needs of a result."""

    solution: dict | None


def test_solve_adds_the_times_to_its_result_if_there_can_be_any(export, tmp_path, capsys):
    file = load(str(tmp_path / "problem.toml"))
    timed = present._retimed(Found(SOLUTION), file)
    assert timed.solution.items() >= SOLUTION.items()
    assert list(timed.solution["trajectory"]) == ["t", "q", "qd", "qdd", "torque"]
    assert capsys.readouterr().err.startswith("retimed: ")
    assert present._retimed(Found(None), file).solution is None
    (tmp_path / "arm.urdf").write_text(arm_urdf(effort=20.0))
    assert present._retimed(Found(SOLUTION), load(str(tmp_path / "problem.toml"))).solution == SOLUTION
    assert capsys.readouterr().err.startswith(
        "warning: no times: --retime: expected a path on which the joints can hold"
    )


def test_without_retiming_it_stops_at_each_corner(export):
    code, out, err = export(SOLUTION, "--format", "json")
    assert (code, err.splitlines()[-1]) == (0, "note: it rests at 1 corner of the path")
    rows = np.array(json.loads(out)["rows"])
    assert SOLUTION["path"][1] in rows[:, 1:4].tolist()
    assert np.all(np.abs(rows[:, 4:7]) <= [1.0 + 1e-9, 2.0 + 1e-9, 2.0 + 1e-9])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--blend", 0.1], "--blend: expected only with --retime, found 0.1"),
        (["--retime", "--turn-speed", 1], "--turn-speed: expected none for robot-path, whose joints move at --speed, "),
        (["--retime", "--blend", -1], "--blend: expected a number, 0 or greater, found -1 (see "),
    ],
)
def test_options_that_do_not_fit_are_refused(export, options, said):
    code, out, err = export(SOLUTION, *options)
    assert (code, out) == (2, "")
    assert err.startswith(f"error: {said}") or f"argument {said}" in err
