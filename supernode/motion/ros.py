"""Write motions as a message of ROS, trajectory_msgs/JointTrajectory, in the JSON form of rosbridge and the like.

Points have positions and velocities alone. ROS's joint trajectory controller then puts a cubic between two of them,
which is the motion that was checked. With accelerations, which may jump at a point, it would put another curve between
them, and several versions of it refuse points with efforts.
"""

import json
from typing import Any

from problems import BadInput
from problems.motion import Joints, Motion

Json = dict[str, Any]

_NANO = 1_000_000_000


def as_joint_trajectory(motion: Motion) -> str:
    """Return one JSON object: ``header``, ``joint_names``, and ``points`` with ``time_from_start`` of each.

    The joints of several arms follow each other in one message, under names such as ``robot_1.joint_1``.

    Raises:
        BadInput: if something else than joints moves.
    """
    arms = [track for track in motion.tracks if isinstance(track, Joints)]
    if not arms or len(arms) < len(motion.tracks):
        raise BadInput("--format: expected csv, json or mcap, as not only joints move in this motion, found ros")
    message = {
        "header": {"stamp": stamp(0.0), "frame_id": ""},
        "joint_names": [f"{arm.name}.{joint}" if arm.name else joint for arm in arms for joint in arm.joints],
        "points": [_point(arms, row, time) for row, time in enumerate(motion.times.tolist())],
    }
    return json.dumps(message) + "\n"


def _point(arms: list[Joints], row: int, time: float) -> Json:
    """Return a trajectory_msgs/JointTrajectoryPoint; without velocities unless those of all arms are known."""
    known = [arm.velocity for arm in arms if arm.velocity is not None]
    return {
        "positions": [value for arm in arms for value in arm.position[row].tolist()],
        "velocities": [value for each in known for value in each[row].tolist()] if len(known) == len(arms) else [],
        "accelerations": [],
        "effort": [],
        "time_from_start": stamp(time),
    }


def stamp(time: float) -> Json:
    """Return a builtin_interfaces/Time or Duration."""
    sec, nanosec = divmod(round(time * _NANO), _NANO)
    return {"sec": sec, "nanosec": nanosec}
