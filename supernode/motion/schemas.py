"""JSON schemas of the messages in an exported motion: the schemas that Foxglove knows by name, as far as they are used.

They follow Foxglove's documentation, but hold no references: not every reader of MCAP files follows those.
"""

from typing import Any

Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
TEXT: Schema = {"type": "string"}


def table(title: str, **properties: Schema) -> Schema:
    """Return the schema of an object with these fields, all required."""
    return {
        "title": title,
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }


def many(item: Schema) -> Schema:
    """Return the schema of an array."""
    return {"type": "array", "items": item}


def _moment(title: str) -> Schema:
    seconds = {"type": "integer", "minimum": 0}
    return table(title, sec=seconds, nsec=seconds | {"maximum": 999_999_999})


_NONE: Schema = many({"type": "object"})
_TIME = _moment("time")
_VECTOR = table("foxglove.Vector3", x=NUMBER, y=NUMBER, z=NUMBER)
_POINT = table("foxglove.Point3", x=NUMBER, y=NUMBER, z=NUMBER)
_QUATERNION = table("foxglove.Quaternion", x=NUMBER, y=NUMBER, z=NUMBER, w=NUMBER)
_POSE = table("foxglove.Pose", position=_VECTOR, orientation=_QUATERNION)
_COLOR = table("foxglove.Color", r=NUMBER, g=NUMBER, b=NUMBER, a=NUMBER)
_LINE = table(
    "foxglove.LinePrimitive",
    type={"type": "integer", "minimum": 0, "maximum": 2},
    pose=_POSE,
    thickness=NUMBER,
    scale_invariant={"type": "boolean"},
    points=many(_POINT),
    color=_COLOR,
    colors=many(_COLOR),
    indices=many({"type": "integer", "minimum": 0}),
)
_SHAPES = ("arrows", "cubes", "spheres", "cylinders", "triangles", "texts", "models")
_ENTITY = table(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_moment("duration"),
    frame_locked={"type": "boolean"},
    metadata=_NONE,
    lines=many(_LINE),
    **dict.fromkeys(_SHAPES, _NONE),
)

_JOINT_STATE = table(
    "foxglove.JointState", name=TEXT, position=NUMBER, velocity=NUMBER, acceleration=NUMBER, effort=NUMBER
)

JOINT_STATES = table(
    "foxglove.JointStates",
    timestamp=_TIME,
    joints=many(_JOINT_STATE | {"required": ["name", "position"]}),
)
POSE_IN_FRAME = table("foxglove.PoseInFrame", timestamp=_TIME, frame_id=TEXT, pose=_POSE)
FRAME_TRANSFORM = table(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=TEXT,
    child_frame_id=TEXT,
    translation=_VECTOR,
    rotation=_QUATERNION,
)
SCENE_UPDATE = table("foxglove.SceneUpdate", deletions=_NONE, entities=many(_ENTITY))

NO_SHAPES: dict[str, list[Any]] = {name: [] for name in ("metadata", *_SHAPES)}
"""The fields of a scene entity other than its lines: all empty."""


def values(names: list[str]) -> Schema:
    """Return the schema of a message of numbers that are neither joint angles nor a pose."""
    return table("supernode.Values", timestamp=_TIME, **dict.fromkeys(names, NUMBER))
