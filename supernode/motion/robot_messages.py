"""Messages about robots from URDFs: joint states and description as ROS has them, frames of links, shapes in space.

Foxglove moves a URDF by the joint states, once the topic of its description is shown. Viewers without the URDF's meshes
show its collision shapes, which are in the file, in the frames of the links.
"""

from collections.abc import Iterator

import numpy as np

from problems.motion import Floats, Frame, Joints, Motion, Solid
from supernode.motion import schemas
from supernode.motion.messages import Json, Message, frame_transform, moment, rotation, vector
from supernode.motion.ros import stamp

_GREY = {"r": 0.6, "g": 0.55, "b": 0.45, "a": 0.6}  # of what stands still
_COLOR = {"r": 0.85, "g": 0.33, "b": 0.1, "a": 1.0}  # of the robot


def of_robot(arm: Joints, times: Floats) -> Iterator[Message]:
    """Yield the robot's description once, and all its joints at each time: also those that stand still."""
    start = f"/{arm.name}" if arm.name else ""
    yield Message(float(times[0]), f"{start}/robot_description", schemas.ROS_STRING, {"data": arm.urdf})
    names = [*arm.joints, *(name for name, _ in arm.standing)]
    still = [value for _, value in arm.standing]
    for row, time in enumerate(times.tolist()):
        known = {"velocity": arm.velocity, "effort": arm.effort}
        state: Json = {"header": {"stamp": stamp(time), "frame_id": ""}, "name": names}
        state["position"] = [*arm.position[row].tolist(), *still]
        for name, values in known.items():
            # The message wants a value for each joint, or none at all.
            state[name] = [] if values is None else [*values[row].tolist(), *(0.0 for _ in still)]
        yield Message(time, f"{start}/joint_states", schemas.ROS_JOINT_STATE, state)


def of_frames(motion: Motion) -> Iterator[Message]:
    """Yield the transforms of all frames at the first time, and of those that move at all others."""
    for row, time in enumerate(motion.times.tolist()):
        frames = [frame for frame in motion.frames if row == 0 or len(frame.places) > 1]
        if frames:
            transforms = [_transform(frame, row, time) for frame in frames]
            yield Message(time, "/tf", schemas.FRAME_TRANSFORMS, {"transforms": transforms})


def _transform(frame: Frame, row: int, time: float) -> Json:
    row = min(row, len(frame.places) - 1)
    place, turn = vector(frame.places[row]), rotation(frame.quaternions[row])
    return frame_transform(time, frame.parent, frame.name, place, turn)


def of_solids(motion: Motion) -> Iterator[Message]:
    """Yield one message with all shapes; each stays where its frame is."""
    if motion.solids:
        time = float(motion.times[0])
        moving = {frame.name for frame in motion.frames}
        entities = [_entity(solid, time, _COLOR if solid.frame in moving else _GREY) for solid in motion.solids]
        yield Message(time, "/shapes", schemas.SCENE_UPDATE, {"deletions": [], "entities": entities})


def _entity(solid: Solid, time: float, color: Json) -> Json:
    said: Json = {"timestamp": moment(time), "frame_id": solid.frame, "id": solid.name}
    said |= {"lifetime": {"sec": 0, "nsec": 0}, "frame_locked": True}
    pose = {"position": vector(solid.place), "orientation": rotation(solid.quaternion)}
    if solid.triangles is not None:
        points = np.round(solid.triangles.reshape(-1, 3), 5)
        corners, indices = np.unique(points, axis=0, return_inverse=True)
        shape = {"pose": pose, "points": [vector(each) for each in corners], "color": color, "colors": []}
        return said | schemas.NO_SHAPES | {"triangles": [shape | {"indices": indices.ravel().tolist()}]}
    size = vector(np.array(solid.size))
    shape = {"pose": pose, "size": size, "color": color}
    match solid.shape:
        case "box":
            return said | schemas.NO_SHAPES | {"cubes": [shape]}
        case "sphere":
            return said | schemas.NO_SHAPES | {"spheres": [shape]}
    return said | schemas.NO_SHAPES | {"cylinders": [shape | {"bottom_scale": 1.0, "top_scale": 1.0}]}
