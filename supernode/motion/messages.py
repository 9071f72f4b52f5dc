"""The parts of messages in MCAP files: moments, vectors, transforms."""

from typing import Any, NamedTuple

from problems.motion import Floats
from supernode.motion.schemas import Schema

Json = dict[str, Any]


class Message(NamedTuple):
    """A message of a topic, at a time in s."""

    time: float
    topic: str
    schema: Schema
    fields: Json


def nanoseconds(time: float) -> int:
    """Return a time in whole nanoseconds."""
    return round(time * 1e9)


def moment(time: float) -> Json:
    """Return a time or duration as Foxglove has it."""
    sec, nsec = divmod(nanoseconds(time), 1_000_000_000)
    return {"sec": sec, "nsec": nsec}


def vector(place: Floats) -> Json:
    """Return a vector or point of three numbers."""
    return dict(zip("xyz", place.tolist(), strict=True))


def rotation(quaternion: Floats) -> Json:
    """Return a quaternion x, y, z, w."""
    return dict(zip("xyzw", quaternion.tolist(), strict=True))


def frame_transform(time: float, parent: str, child: str, place: Json, turn: Json) -> Json:
    """Return the transform of a frame."""
    frames = {"parent_frame_id": parent, "child_frame_id": child}
    return {"timestamp": moment(time)} | frames | {"translation": place, "rotation": turn}
