"""The robot of the proof: pinocchio's kinematics of a URDF, its shapes, and how far each point may move.

Nothing here is used by planners.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np

from problems.errors import BadInput, shorten
from problems.robots.proof_shapes import Floats, pose_of, shapes_of_links

Table = Mapping[str, Any]

_MOVING = ("revolute", "continuous", "prismatic")
_FULL_TURN = 2.0 * np.pi
_SIDES = 48  # of the prism around what turns


class Robot:
    """A robot as its URDF describes it, with some joints that move.

    Joints of other types than revolute, continuous, prismatic and fixed stand at their neutral positions.

    Attributes:
        joints: the names of the joints that move, in the order of configurations.
        limits: the lowest and the highest value of each, rad or m, shape (n, 2); -2π and 2π for continuous joints.
        turning: whether each of them turns; the others slide.
        shapes: the shapes of all links; see `link_of`.
        link_of: the link of each shape.
        may_touch: pairs of links that are not tested against each other.
    """

    def __init__(self, fields: Table) -> None:
        """Build the robot of the gathered fields of ``[robot]``.

        Raises:
            BadInput: if pinocchio is not installed, or the fields do not fit the URDF.
        """
        try:
            import coal  # noqa: F401
            import pinocchio
        except ImportError as error:
            raise BadInput(f"robot: {error.name} is not installed: pip install 'supernode[robots]'") from error
        self._pinocchio = pinocchio
        self._urdf = _parsed(fields["urdf"], "urdf")
        self._srdf = _parsed(fields["srdf"], "srdf") if fields.get("srdf") else None
        self._joints = {str(joint.get("name")): joint for joint in self._urdf.findall("joint")}
        self.joints = self._chosen(fields)
        self.limits = np.array([self._limits_of(name) for name in self.joints]).reshape(-1, 2)
        self.turning = np.array([self._joints[name].get("type") != "prismatic" for name in self.joints], np.bool_)
        self._model = _built(pinocchio, self._urdf)
        self._data = self._model.createData()
        self._base = pose_of(fields.get("base") or {})
        self._place_base()
        self._rest, self._sources = self._rules(fields.get("fixed") or {})
        self._fill_rows()
        found = shapes_of_links(self._urdf, dict(fields.get("meshes") or {}))
        self.shapes = [shape for _, shape in found]
        self.link_of = [link for link, _ in found]
        self.may_touch = self._allowed()

    # Which joints move ------------------------------------------------------------------------------------------------
    def _chosen(self, fields: Table) -> tuple[str, ...]:
        movable = [name for name, joint in self._joints.items() if _moves(joint)]
        if fields.get("joints"):
            unknown = [name for name in fields["joints"] if name not in movable]
            if unknown:
                raise BadInput(f"robot.joints: expected joints that move, found {unknown[0]!r}")
            return tuple(fields["joints"])
        named = self._of_group(fields["group"], ()) if fields.get("group") else self._below(self._root())
        return tuple(name for name in dict.fromkeys(named) if name in movable)

    def _root(self) -> str:
        carried = {_child(joint) for joint in self._joints.values()}
        return next(name for link in self._urdf.findall("link") if (name := str(link.get("name"))) not in carried)

    def _below(self, link: str) -> Iterator[str]:
        """Yield the joints below a link, depth first, those of one link in the order of the URDF."""
        for name, joint in self._joints.items():
            if _parent(joint) == link:
                yield name
                yield from self._below(_child(joint))

    def _above(self, link: str) -> Iterator[str]:
        """Yield the joints from a link up to the root."""
        parents = {_child(joint): name for name, joint in self._joints.items()}
        while link in parents:
            yield parents[link]
            link = _parent(self._joints[parents[link]])

    def _of_group(self, name: str, within: tuple[str, ...]) -> Iterator[str]:
        groups = (
            [] if self._srdf is None else [each for each in self._srdf.findall("group") if each.get("name") == name]
        )
        if not groups or name in within:
            raise BadInput(f"robot.group: expected a group of the SRDF, found {name!r}")
        for part in (each for group in groups for each in group):
            match part.tag:
                case "joint":
                    yield str(part.get("name"))
                case "link":
                    yield from list(self._above(str(part.get("name"))))[:1]
                case "chain":
                    above_base = set(self._above(str(part.get("base_link"))))
                    chain = [each for each in self._above(str(part.get("tip_link"))) if each not in above_base]
                    yield from reversed(chain)
                case "group":
                    yield from self._of_group(str(part.get("name")), (*within, name))

    def _limits_of(self, name: str) -> tuple[float, float]:
        joint = self._joints[name]
        limit = joint.find("limit")
        if joint.get("type") == "continuous" or limit is None:
            return -_FULL_TURN, _FULL_TURN
        return float(limit.get("lower", 0.0)), float(limit.get("upper", 0.0))

    # Kinematics -------------------------------------------------------------------------------------------------------
    def _place_base(self) -> None:
        """Move the joints at the root by the pose of the base, so that all of pinocchio's poses are in the world."""
        base = self._pinocchio.SE3(self._base)
        for joint in range(1, self._model.njoints):
            if self._model.parents[joint] == 0:
                self._model.jointPlacements[joint] = base * self._model.jointPlacements[joint]

    def _rules(self, fixed: Mapping[str, float]) -> tuple[Floats, dict[int, tuple[int, float, float]]]:
        """Return each pinocchio joint's value at rest, and of those that move: variable, multiplier and offset."""
        rest, sources = np.zeros(self._model.njoints), {}
        for number in range(1, self._model.njoints):
            name = self._model.names[number]
            variable, multiplier, offset = self._source(name)
            if variable in self.joints:
                sources[number] = self.joints.index(variable), multiplier, offset
            elif variable in self._joints and self._joints[variable].get("type") in _MOVING:
                value = fixed.get(variable, float(np.clip(0.0, *self._limits_of(variable))))
                rest[number] = multiplier * value + offset
        return rest, sources

    def _source(self, name: str) -> tuple[str, float, float]:
        """Return the joint that a joint mimics, through several if need be, with multiplier and offset."""
        multiplier, offset = 1.0, 0.0
        for _ in self._joints:  # as many steps as there are joints end even a circle
            mimic = self._joints[name].find("mimic") if name in self._joints else None
            if mimic is None:
                break
            own = float(mimic.get("multiplier", 1.0))
            offset += multiplier * float(mimic.get("offset", 0.0))
            multiplier *= own
            name = str(mimic.get("joint"))
        return name, multiplier, offset

    def _fill_rows(self) -> None:
        """Prepare `full`: where the numbers of joints that move are in pinocchio's vector, and how they follow."""
        model = self._model
        self._whole: Floats = self._pinocchio.neutral(model)
        # Place in the vector, variable, multiplier and offset; of joints with one number, and with cosine and sine.
        self._straight: list[tuple[int, int, float, float]] = []
        self._round: list[tuple[int, int, float, float]] = []
        for number in range(1, model.njoints):
            at, size = model.joints[number].idx_q, model.joints[number].nq
            if number in self._sources:
                (self._straight if size == 1 else self._round).append((at, *self._sources[number]))
            elif size == 1:
                self._whole[at] = self._rest[number]
            elif size == 2:  # continuous: pinocchio has the cosine and the sine
                self._whole[at : at + 2] = np.cos(self._rest[number]), np.sin(self._rest[number])

    def full(self, configuration: Any) -> Floats:
        """Return pinocchio's vector of all joints for a configuration, rad or m, shape (n,)."""
        whole = self._whole
        for at, variable, multiplier, offset in self._straight:
            whole[at] = multiplier * configuration[variable] + offset
        for at, variable, multiplier, offset in self._round:
            angle = multiplier * configuration[variable] + offset
            whole[at], whole[at + 1] = math.cos(angle), math.sin(angle)
        return whole

    def place(self, configuration: Any) -> Floats:
        """Return the frames of all pinocchio joints in the world, shape (joints, 4, 4); joint 0 is the world itself."""
        self._pinocchio.forwardKinematics(self._model, self._data, self.full(configuration))
        return np.array([placement.homogeneous for placement in self._data.oMi])

    def attachment(self, link: str) -> tuple[int, Floats]:
        """Return the pinocchio joint that carries a link, and the link's frame in that of the joint, 4×4.

        Raises:
            BadInput: if there is no such link.
        """
        for frame in self._model.frames:
            if frame.name == link and frame.type == self._pinocchio.FrameType.BODY:
                placement: Floats = frame.placement.homogeneous
                return frame.parentJoint, self._base @ placement if frame.parentJoint == 0 else placement
        links = ", ".join(str(each.get("name")) for each in self._urdf.findall("link"))
        raise BadInput(f"link: expected one of {shorten(links)}, found {link!r}")

    def pose(self, configuration: Any, link: str) -> Floats:
        """Return the frame of a link in the world, a 4×4 matrix."""
        joint, placement = self.attachment(link)
        frame: Floats = self.place(configuration)[joint] @ placement
        return frame

    # Motion -----------------------------------------------------------------------------------------------------------
    def body(self, joint: int) -> int:
        """Return the nearest joint that moves, from a pinocchio joint towards the root; 0 if there is none."""
        while joint and joint not in self._sources:
            joint = self._model.parents[joint]
        return joint

    def movers(self, joint: int) -> list[int]:
        """Return the joints that move a pinocchio joint's frame, from it to the root."""
        found = []
        while joint:
            if joint in self._sources:
                found.append(joint)
            joint = self._model.parents[joint]
        return found

    def variable(self, joint: int) -> tuple[int, float]:
        """Return the variable of a joint that moves, and the size of its multiplier."""
        variable, multiplier, _ = self._sources[joint]
        return variable, abs(multiplier)

    def reach(self, joint: int, points: Floats, rounding: float) -> dict[int, float]:
        """Return how far points may move when a joint turns by 1 rad or slides by 1 m, for each joint that moves them.

        The bounds hold for all configurations within limits. A turn moves a point by its distance from the axis. All
        places to which the joints beyond an axis may bring the points are enclosed in a polyhedron, whose corners take
        their place on the way to the root.

        Args:
            joint: the pinocchio joint that carries the points.
            points: their places in its frame, m, shape (n, 3).
            rounding: the radius of balls about the points, m.
        """
        found: dict[int, float] = {}
        still = self.place((self.limits.sum(axis=1)) / 2.0)
        while joint:
            parent = self._model.parents[joint]
            if joint not in self._sources:
                placement = np.linalg.inv(still[parent]) @ still[joint]
            elif self._slides(joint):
                found[joint] = 1.0
                points = np.concatenate([points + end * self._axis(joint) for end in self._travel(joint)])
            else:
                found[joint] = _from_axis(points, self._axis(joint)) + rounding
                points = _turned(points, self._axis(joint))
            if joint in self._sources:
                placement = self._model.jointPlacements[joint].homogeneous
            points = points @ placement[:3, :3].T + placement[:3, 3]
            joint = parent
        return found

    def _slides(self, joint: int) -> bool:
        return bool(self._joints[self._model.names[joint]].get("type") == "prismatic")

    def _travel(self, joint: int) -> Floats:
        """Return both ends of the way of a sliding joint, m, shape (2,)."""
        variable, multiplier, offset = self._sources[joint]
        ends: Floats = multiplier * self.limits[variable] + offset
        return ends

    def _axis(self, joint: int) -> Floats:
        axis = self._joints[self._model.names[joint]].find("axis")
        direction = np.array([float(each) for each in ("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split()])
        unit: Floats = direction / np.linalg.norm(direction)
        return unit

    # Pairs ------------------------------------------------------------------------------------------------------------
    def _allowed(self) -> set[frozenset[str]]:
        """Return the pairs of links that may touch: those of the SRDF, and the two links of every joint."""
        apart = {frozenset((_parent(joint), _child(joint))) for joint in self._joints.values()}
        if self._srdf is None:
            return apart
        links = [str(link.get("name")) for link in self._urdf.findall("link")]
        exempt = {str(each.get("link")) for each in self._srdf.findall("disable_default_collisions")}
        by_default = {frozenset((one, other)) for one in exempt for other in links}
        return apart | ((by_default | _pairs(self._srdf, "disable")) - _pairs(self._srdf, "enable"))

    def geometry(self) -> tuple[Any, Any, Any]:
        """Return pinocchio with the model and the data that its functions for geometry take."""
        return self._pinocchio, self._model, self._data


def _built(pinocchio: Any, urdf: ElementTree.Element) -> Any:
    """Return pinocchio's model of a URDF's links and joints.

    Only what kinematics needs is passed on: pinocchio's parser refuses shapes, and limits without effort and velocity,
    that say nothing about kinematics.
    """
    bare = ElementTree.Element("robot", name="robot")
    for link in urdf.findall("link"):
        ElementTree.SubElement(bare, "link", name=str(link.get("name")))
    for joint in urdf.findall("joint"):
        own = ElementTree.SubElement(bare, "joint", dict(joint.attrib))
        own.extend(joint.findall(tag)[0] for tag in ("origin", "parent", "child", "axis") if joint.findall(tag))
        if joint.get("type") in ("revolute", "prismatic"):
            ElementTree.SubElement(own, "limit", lower="-1", upper="1", effort="1", velocity="1")
    try:
        return pinocchio.buildModelFromXML(ElementTree.tostring(bare, encoding="unicode"))
    except ValueError as error:
        raise BadInput(f"robot.urdf: expected a URDF that pinocchio reads, found another text: {error}") from None


def _pairs(srdf: ElementTree.Element, what: str) -> set[frozenset[str]]:
    found = srdf.findall(f"{what}_collisions")
    return {frozenset((str(each.get("link1")), str(each.get("link2")))) for each in found}


def _moves(joint: ElementTree.Element) -> bool:
    return joint.get("type") in _MOVING and joint.find("mimic") is None


def _parent(joint: ElementTree.Element) -> str:
    element = joint.find("parent")
    return "" if element is None else str(element.get("link"))


def _child(joint: ElementTree.Element) -> str:
    element = joint.find("child")
    return "" if element is None else str(element.get("link"))


def _from_axis(points: Floats, axis: Floats) -> float:
    """Return the greatest distance of points from a line through the origin."""
    away = points - np.outer(points @ axis, axis)
    return float(np.linalg.norm(away, axis=1).max())


def _turned(points: Floats, axis: Floats) -> Floats:
    """Return the corners of a prism about an axis that contains all places of points that turn about it."""
    heights, radius = points @ axis, _from_axis(points, axis) / np.cos(np.pi / _SIDES)
    across = np.linalg.svd(axis[None])[2][1:]  # two directions at right angles to the axis
    bearings = np.arange(_SIDES) * (2.0 * np.pi / _SIDES)
    ring = radius * np.column_stack([np.cos(bearings), np.sin(bearings)]) @ across
    prism: Floats = np.concatenate([ring + height * axis for height in (heights.min(), heights.max())])
    return prism


def _parsed(text: str, field: str) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise BadInput(f"robot.{field}: expected XML, found a text that is none: {error}") from None
