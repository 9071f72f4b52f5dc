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
_CUBE = table("foxglove.CubePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_SPHERE = table("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR, color=_COLOR)
_CYLINDER = table(
    "foxglove.CylinderPrimitive", pose=_POSE, size=_VECTOR, bottom_scale=NUMBER, top_scale=NUMBER, color=_COLOR
)
_TRIANGLES = table(
    "foxglove.TriangleListPrimitive",
    pose=_POSE,
    points=many(_POINT),
    color=_COLOR,
    colors=many(_COLOR),
    indices=many({"type": "integer", "minimum": 0}),
)
_UNUSED = ("arrows", "texts", "models")
_ENTITY = table(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=TEXT,
    id=TEXT,
    lifetime=_moment("duration"),
    frame_locked={"type": "boolean"},
    metadata=_NONE,
    lines=many(_LINE),
    cubes=many(_CUBE),
    spheres=many(_SPHERE),
    cylinders=many(_CYLINDER),
    triangles=many(_TRIANGLES),
    **dict.fromkeys(_UNUSED, _NONE),
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
FRAME_TRANSFORMS = table("foxglove.FrameTransforms", transforms=many(FRAME_TRANSFORM))
SCENE_UPDATE = table("foxglove.SceneUpdate", deletions=_NONE, entities=many(_ENTITY))

NO_SHAPES: dict[str, list[Any]] = {
    name: [] for name in ("metadata", "lines", "cubes", "spheres", "cylinders", "triangles", *_UNUSED)
}
"""The fields of a scene entity that hold shapes: all empty."""

# Messages of ROS 2 in JSON. Viewers know them by their names, whatever the encoding.
_STAMP = table("builtin_interfaces/msg/Time", sec={"type": "integer"}, nanosec={"type": "integer", "minimum": 0})
_HEADER = table("std_msgs/msg/Header", stamp=_STAMP, frame_id=TEXT)
ROS_JOINT_STATE = table(
    "sensor_msgs/msg/JointState",
    header=_HEADER,
    name=many(TEXT),
    position=many(NUMBER),
    velocity=many(NUMBER),
    effort=many(NUMBER),
)
ROS_STRING = table("std_msgs/msg/String", data=TEXT)


def values(names: list[str]) -> Schema:
    """Return the schema of a message of numbers that are neither joint angles nor a pose."""
    return table("supernode.Values", timestamp=_TIME, **dict.fromkeys(names, NUMBER))
