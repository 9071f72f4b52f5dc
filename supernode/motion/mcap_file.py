"""Write motions as MCAP files of JSON messages, for Foxglove and the like: joints, poses, and the scene in lines.

What does not move has a topic of its own: a viewer that jumps to a time shows the last message of each topic before it.
Positions are in the frame ``world``. The log time of a message is the time of its row, in nanoseconds from 0.
"""

import io
import json
from collections.abc import Iterator

import numpy as np

from problems import BadInput
from problems.motion import WORLD, Body, Floats, Joints, Motion, Track, Values
from supernode.motion import robot_messages, schemas
from supernode.motion.messages import Json, Message, frame_transform, moment, nanoseconds, vector

_STRIP, _LOOP = 0, 1  # Foxglove's types of a line: an open one, a closed one
_PIXELS = 3.0  # thickness of lines; with `scale_invariant` it is in pixels
_GREY = {"r": 0.45, "g": 0.45, "b": 0.45, "a": 1.0}  # of obstacles
_COLORS = ({"r": 0.85, "g": 0.33, "b": 0.1, "a": 1.0}, {"r": 0.1, "g": 0.45, "b": 0.75, "a": 1.0})  # of robots


def as_mcap(motion: Motion) -> bytes:
    """Return the motion as the bytes of an MCAP file, with its messages in the order of time.

    Raises:
        BadInput: if the package `mcap` is not installed.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise BadInput("--format: writing MCAP needs the package mcap: pip install 'supernode[mcap]'") from error
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(profile="", library="supernode")
    channels: dict[str, int] = {}
    # The sort is stable: what stands still comes before the first row of the same time.
    for message in sorted(_messages(motion), key=lambda message: message.time):
        if message.topic not in channels:
            schema = json.dumps(message.schema).encode()
            known = writer.register_schema(message.schema["title"], "jsonschema", schema)
            channels[message.topic] = writer.register_channel(message.topic, "json", known)
        when = nanoseconds(message.time)
        data = json.dumps(message.fields).encode()
        writer.add_message(channels[message.topic], log_time=when, data=data, publish_time=when)
    if motion.limits or motion.notes:
        said = {limit.name: f"{list(limit.values)} {limit.unit} ({limit.source})" for limit in motion.limits}
        writer.add_metadata("limits", said | {f"note {number}": note for number, note in enumerate(motion.notes, 1)})
    for track in motion.tracks:
        if isinstance(track, Joints) and track.urdf is not None:
            name = f"{track.name or 'robot'}.urdf"
            writer.add_attachment(0, 0, name, "application/xml", track.urdf.encode())
    writer.finish()
    return stream.getvalue()


def _messages(motion: Motion) -> Iterator[Message]:
    standing = _standing(motion)
    if standing:
        yield _scene(float(motion.times[0]), "/scene", standing)
    yield from robot_messages.of_frames(motion)
    yield from robot_messages.of_solids(motion)
    for number, track in enumerate(motion.tracks):
        if isinstance(track, Joints) and track.urdf is not None:
            yield from robot_messages.of_robot(track, motion.times)
        for row, time in enumerate(motion.times.tolist()):
            yield from _row(track, row, time, _COLORS[number % len(_COLORS)])


def _row(track: Track, row: int, time: float, color: Json) -> Iterator[Message]:
    stamp = {"timestamp": moment(time)}
    match track:
        case Joints():
            yield Message(time, _topic(track, "joints"), schemas.JOINT_STATES, stamp | {"joints": _joints(track, row)})
            if track.links is not None:
                arm = _entity(time, track.name or "arm", WORLD, [_line(_STRIP, track.links[row], color)])
                yield _scene(time, _topic(track, "links"), [arm])
        case Body():
            yield from _pose(track, row, time)
        case Values():
            named = {column.name: float(column.values[row]) for column in track.columns}
            yield Message(time, _topic(track, "values"), schemas.values(list(named)), stamp | named)


def _topic(track: Track, what: str) -> str:
    return f"/{track.name}/{what}" if track.name else f"/{what}"


def _joints(track: Joints, row: int) -> list[Json]:
    known = {name: values[row].tolist() for name, (_, values) in track.quantities.items()}
    return [
        {"name": joint} | {name: values[number] for name, values in known.items()}
        for number, joint in enumerate(track.joints)
    ]


def _pose(track: Body, row: int, time: float) -> Iterator[Message]:
    """Yield the pose, and the same as the transform of the body's frame: its outline is drawn in that frame."""
    stamp = {"timestamp": moment(time)}
    place, turn = vector(track.places[row]), _quaternion(track.angles[row])
    pose = {"frame_id": WORLD, "pose": {"position": place, "orientation": turn}}
    yield Message(time, _topic(track, "pose"), schemas.POSE_IN_FRAME, stamp | pose)
    yield Message(time, "/tf", schemas.FRAME_TRANSFORM, frame_transform(time, WORLD, _frame(track), place, turn))


def _frame(track: Body) -> str:
    return track.name or "robot"


# The scene ------------------------------------------------------------------------------------------------------------
def _standing(motion: Motion) -> list[Json]:
    """Return what is drawn once: obstacles in the world, and the outlines of bodies in their own frames."""
    time = float(motion.times[0])
    found = [
        _entity(time, _frame(track), _frame(track), [_line(_LOOP, track.outline, _COLORS[number % len(_COLORS)])])
        for number, track in enumerate(motion.tracks)
        if isinstance(track, Body) and track.outline is not None
    ]
    if motion.obstacles:
        found.append(_entity(time, "obstacles", WORLD, [_line(_LOOP, each, _GREY) for each in motion.obstacles]))
    return found


def _scene(time: float, topic: str, entities: list[Json]) -> Message:
    return Message(time, topic, schemas.SCENE_UPDATE, {"deletions": [], "entities": entities})


def _entity(time: float, name: str, frame: str, lines: list[Json]) -> Json:
    """Return a scene entity of lines; it stays until another of that name replaces it, and follows its frame."""
    forever = {"sec": 0, "nsec": 0}
    said = {"timestamp": moment(time), "frame_id": frame, "id": name, "lifetime": forever, "frame_locked": True}
    return said | schemas.NO_SHAPES | {"lines": lines}


def _line(kind: int, points: Floats, color: Json) -> Json:
    return {
        "type": kind,
        "pose": {"position": vector(np.zeros(3)), "orientation": _quaternion(np.zeros(3))},
        "thickness": _PIXELS,
        "scale_invariant": True,
        "points": [vector(point) for point in points],
        "color": color,
        "colors": [],
        "indices": [],
    }


def _quaternion(angles: Floats) -> Json:
    """Return the quaternion of a roll about x, then a pitch about y, then a yaw about z; all axes are fixed."""
    (c_x, c_y, c_z), (s_x, s_y, s_z) = np.cos(angles / 2.0).tolist(), np.sin(angles / 2.0).tolist()
    return {
        "x": s_x * c_y * c_z - c_x * s_y * s_z,
        "y": c_x * s_y * c_z + s_x * c_y * s_z,
        "z": c_x * c_y * s_z - s_x * s_y * c_z,
        "w": c_x * c_y * c_z + s_x * s_y * s_z,
    }
