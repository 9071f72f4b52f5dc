"""Read MoveIt's messages as YAML or JSON: planning scenes, motion-plan requests, or both in one file.

Fields are those of moveit_msgs/PlanningScene and moveit_msgs/MotionPlanRequest. As robowflex and MotionBenchMaker write
them, points and quaternions may be lists, shapes may have names in place of numbers, meshes may be files, and a frame
that is not given is the world. A file may hold a scene and a request under ``scene`` and ``request``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from problems.errors import BadInput
from supernode.scenes import shapes
from supernode.scenes.places import Floats
from supernode.scenes.plain_node import Node, place_of
from supernode.scenes.scene import WORLD, Attached, Mesh, PoseGoal, Scene, Solid

_SCENES = ("scene", "planning_scene")
_REQUESTS = ("request", "motion_plan_request")
_KNOWN = ("world", "collision_objects", "robot_state", "start_state", "goal_constraints", "fixed_frame_transforms")
_LEAST_TOLERANCE = 1e-6
_ANGLE_TOLERANCE = 1e-3  # rad: the default of problem files
_ADD = (0, 2, "add", "append", "\0", "\2", "b'\\x00'", "b'\\x02'")  # operations of a CollisionObject, also as bytes


def read_messages(plain: Any, file: str) -> Scene:
    """Return what a file's plain values say.

    Raises:
        BadInput: if they are no planning scene and no request, or a field is wrong; the message names file and field.
    """
    whole = Node(plain, file)
    if not isinstance(plain, Mapping):
        raise whole.error("a planning scene or a motion-plan request")
    inner = [found for name in (*_SCENES, *_REQUESTS) if (found := whole.get(name)) is not None]
    parts = [each for each in (whole, *inner) if isinstance(each.value, Mapping) and set(_KNOWN) & set(each.value)]
    if not parts:
        raise whole.error(f"a planning scene or a motion-plan request with one of {', '.join(_KNOWN)}")
    scene = Scene()
    for part in parts:
        scene = scene.joined(_part(part))
    return scene


def _part(node: Node) -> Scene:
    world, model, group = node.get("world"), node.get("robot_model_name"), node.get("group_name")
    objects = [*node.each("collision_objects"), *([] if world is None else world.each("collision_objects"))]
    solids = [solid for each in objects for solid in _solids(each, WORLD)]
    notes = [] if world is None or not _has_octomap(world) else [f"{world.where}.octomap: left out"]
    scene = Scene(
        solids=solids,
        frames=dict(_frames(node)),
        model=None if model is None else model.text() or None,
        group=None if group is None else group.text() or None,
        notes=notes,
    )
    for name in ("robot_state", "start_state"):
        state = node.get(name)
        if state is not None:
            scene = scene.joined(_state(state))
    return scene.joined(_goals(node))


def _has_octomap(world: Node) -> bool:
    octomap = world.get("octomap")
    inner = None if octomap is None else octomap.get("octomap")
    return inner is not None and inner.get("data") is not None and bool(inner.need("data").value)


# Robot ----------------------------------------------------------------------------------------------------------------
def _state(node: Node) -> Scene:
    values: dict[str, float] = {}
    joints = node.get("joint_state")
    if joints is not None:
        names = joints.each("name")
        position = joints.get("position")
        numbers = [] if position is None else position.numbers()
        if len(names) != len(numbers):
            expected = f"{len(names)} values, one for each name"
            raise BadInput(f"{joints.where}.position: expected {expected}, found {len(numbers)}")
        values = {name.text(): number for name, number in zip(names, numbers, strict=True)}
    attached = [thing for each in node.each("attached_collision_objects") for thing in _attached(each)]
    return Scene(values=values, attached=attached, base=_base(node))


def _base(node: Node) -> Floats | None:
    """Return where a floating or planar joint puts the robot."""
    joints = node.get("multi_dof_joint_state")
    places = [] if joints is None else [each.place("translation", "rotation") for each in joints.each("transforms")]
    if len(places) > 1:
        assert joints is not None
        raise joints.error("at most one joint, which carries the robot")
    return places[0] if places else None


def _attached(node: Node) -> Iterator[Attached]:
    link = node.need("link_name").text()
    may_touch = tuple(each.text() for each in node.each("touch_links"))
    for solid in _solids(node.need("object"), link):
        yield Attached(solid, link, may_touch)


# World ----------------------------------------------------------------------------------------------------------------
def _frames(node: Node) -> Iterator[tuple[str, tuple[str, Floats]]]:
    """Yield the frames that the scene knows besides the robot's.

    In MoveIt's scenes, other than in tf, the transform is the place of the header's frame in the frame of the child.
    """
    for each in node.each("fixed_frame_transforms"):
        name, parent = _frame(each, WORLD), each.need("child_frame_id").text().lstrip("/")
        if name != parent:
            yield name, (parent, each.need("transform").place("translation", "rotation"))


def _frame(node: Node, default: str) -> str:
    header = node.get("header")
    name = None if header is None else header.get("frame_id")
    text = "" if name is None else name.text().lstrip("/")
    return text or default


def _solids(node: Node, default_frame: str) -> Iterator[Solid]:
    name, frame, origin = node.need("id").text().strip(), _frame(node, default_frame), place_of(node.get("pose"))
    operation = node.get("operation")
    if operation is not None and _lower(operation.value) not in _ADD:
        raise operation.error("add or append", "; a scene that changes another cannot be read")
    for planes in node.each("planes")[:1]:
        raise planes.error("box, sphere, cylinder, cone or mesh", ", a plane; use a wide, thin box")
    count = 0
    for shapes_name, poses_name in (("primitives", "primitive_poses"), ("meshes", "mesh_poses")):
        found, poses = node.each(shapes_name), node.each(poses_name)
        if poses and len(poses) != len(found):
            raise node.need(poses_name).error(f"as many places as {shapes_name} ({len(found)})")
        for number, each in enumerate(found):
            fields, mesh = _primitive(each) if shapes_name == "primitives" else _mesh(each)
            pose = origin @ (poses[number].place() if poses else np.eye(4))
            count += 1
            yield Solid(name if count == 1 else f"{name}.{count}", fields, frame, pose, each.where, mesh)
    if not count:
        raise node.error("primitives or meshes")


def _lower(value: Any) -> Any:
    return value.lower() if isinstance(value, str) else value


def _primitive(node: Node) -> tuple[dict[str, Any], Mesh | None]:
    kind, sizes = node.need("type").value, node.need("dimensions").numbers()
    kind = shapes.KINDS.get(kind, kind) if isinstance(kind, int) else str(kind).lower()
    if kind in ("cylinder", "cone"):  # shape_msgs: height, then radius
        sizes = sizes[::-1]
    return shapes.primitive(str(kind), sizes, node.where)


def _mesh(node: Node) -> tuple[dict[str, Any], Mesh | None]:
    resource = node.get("resource")
    if resource is not None:
        scale = node.get("dimensions")
        sizes = {} if scale is None else {"scale": scale.numbers(3)}
        return {"shape": "mesh", "file": resource.text()} | sizes, None
    points = [each.numbers(3) for each in node.each("vertices")]
    corners = []
    for each in node.each("triangles"):
        inner = each.need("vertex_indices") if isinstance(each.value, Mapping) else each
        corners.append([int(number) for number in inner.numbers(3)])
    return {"shape": "mesh"}, shapes.mesh(points, corners, node.where)


# Goals ----------------------------------------------------------------------------------------------------------------
def _goals(node: Node) -> Scene:
    goals: list[dict[str, float]] = []
    poses: list[PoseGoal] = []
    for each in node.each("goal_constraints"):
        joints = each.each("joint_constraints")
        if joints:
            goals.append({one.need("joint_name").text(): one.need("position").number() for one in joints})
        elif each.each("position_constraints"):
            poses.append(_pose(each))
        elif each.each("orientation_constraints"):
            raise each.error("a position_constraint beside the orientation_constraint", "; give the position, too")
    if len(poses) > 1 or (poses and goals):
        raise node.need("goal_constraints").error("configurations, or one pose", "; leave out all but one")
    return Scene(goals=goals, pose=poses[0] if poses else None)


def _pose(node: Node) -> PoseGoal:
    """Return the goal of a position constraint, and of the orientation constraint beside it."""
    at, turns = node.each("position_constraints")[0], node.each("orientation_constraints")
    if len(node.each("position_constraints")) > 1 or len(turns) > 1:
        raise node.error("one position_constraint and at most one orientation_constraint")
    link, frame = at.need("link_name").text(), _frame(at, WORLD)
    rotation, angle = None, _ANGLE_TOLERANCE
    if turns:
        if turns[0].need("link_name").text() != link or _frame(turns[0], WORLD) != frame:
            raise turns[0].error(f"the link {link!r} and the frame {frame!r} of the position_constraint")
        rotation, angle = _rotation(turns[0])
    place, tolerance = _region(at.need("constraint_region"))
    offset = at.get("target_point_offset")
    shift = np.zeros(3) if offset is None else np.array(offset.numbers(3))
    if shift.any():
        if rotation is None:
            raise at.error("no target_point_offset, or an orientation_constraint", "; the link's own place is unknown")
        place = place - rotation @ shift
    return PoseGoal(link, frame, place, rotation, tolerance, angle, at.where)


def _rotation(node: Node) -> tuple[Floats | None, float]:
    tolerances = [each.number() for axis in "xyz" if (each := node.get(f"absolute_{axis}_axis_tolerance")) is not None]
    least = min(tolerances, default=_ANGLE_TOLERANCE)
    if least >= math.pi:
        return None, _ANGLE_TOLERANCE
    pose = Node({"orientation": node.need("orientation").value}, node.file, node.path).place()
    return pose[:3, :3], max(_LEAST_TOLERANCE, least)


def _region(node: Node) -> tuple[Floats, float]:
    """Return the centre of a region, and the radius of the ball in it."""
    primitives, poses = node.each("primitives"), node.each("primitive_poses")
    if len(primitives) != 1 or len(poses) != 1:
        raise node.error("one of primitives, and its primitive_poses")
    fields, mesh = _primitive(primitives[0])
    if mesh is not None:
        raise primitives[0].error("a box, sphere or cylinder")
    sizes = [each / 2 for each in fields.get("size", [])]
    sizes += [fields[name] * part for name, part in (("radius", 1.0), ("length", 0.5)) if name in fields]
    return poses[0].place()[:3, 3], min(1.0, max(_LEAST_TOLERANCE, min(sizes)))
