"""Read a URDF's text: links with their collision geometry, and joints. No other file is opened.

It is read here and not by pinocchio, so that errors name the joint or link and say how to mend it, and so that the
checker, which uses pinocchio, would notice a fault of this reading.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput, did_you_mean
from problems.robots.meshes import UNSCALED, Scale

Floats = NDArray[np.float64]
Triple = tuple[float, float, float]

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints that can move here."""
_TYPES = (*MOVING, "fixed", "floating", "planar")
IDENTITY: Floats = np.eye(3, 4).reshape(12)
WHERE = "robot.urdf"


@dataclass(frozen=True, eq=False)
class Geometry:
    """One collision element: a primitive or a mesh, placed in the frame of its link.

    Attributes:
        shape: ``box``, ``cylinder``, ``sphere``, ``capsule`` or ``mesh``.
        size: full lengths of a box; radius and length (of the cylindrical part) of a cylinder or capsule; radius.
        mesh: the mesh's name as the URDF writes it; empty for a primitive.
        scale: the mesh's factors.
        placement: row-major 3×4 matrix, shape (12,).
    """

    shape: str
    size: tuple[float, ...]
    mesh: str
    scale: Scale
    placement: Floats


@dataclass(frozen=True, eq=False)
class Link:
    """A link with its collision elements, and the number of its visual elements."""

    name: str
    collisions: tuple[Geometry, ...]
    visuals: int


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint between two links.

    Attributes:
        kind: as in the URDF, such as ``revolute``.
        placement: the joint's frame in the frame of the parent link, shape (12,).
        axis: a unit vector in the joint's frame.
        limits: lowest and highest value, rad or m; None if the URDF states none.
        velocity: rad/s or m/s; NaN if it is not stated.
        effort: N m or N; NaN if it is not stated.
        mimic: the joint that it follows, multiplier and offset; None if it moves by itself.
    """

    name: str
    kind: str
    parent: str
    child: str
    placement: Floats
    axis: Floats
    limits: tuple[float, float] | None
    velocity: float
    effort: float
    mimic: tuple[str, float, float] | None


@dataclass(frozen=True, eq=False)
class Urdf:
    """A robot's tree of links and joints.

    Attributes:
        name: the robot's name.
        links: by name, in the order of the file.
        joints: by name, parents before children, else in the order of the file.
        root: the link that no joint carries.
    """

    name: str
    links: dict[str, Link]
    joints: dict[str, Joint]
    root: str

    @property
    def above(self) -> dict[str, Joint]:
        """The joint that carries each link but the root."""
        return {joint.child: joint for joint in self.joints.values()}

    @property
    def movable(self) -> list[str]:
        """The names of the joints that may be variables: they move, and follow no other joint."""
        return [each.name for each in self.joints.values() if each.kind in MOVING and each.mimic is None]

    def way_to(self, link: str) -> list[Joint]:
        """Return the joints from the root to a link, the root's first."""
        above, way = self.above, []
        while link in above:
            way.append(above[link])
            link = above[link].parent
        return way[::-1]


def read_urdf(text: str, where: str = WHERE) -> Urdf:
    """Return the robot of a URDF's text.

    Args:
        text: the XML.
        where: the start of messages: a field, or a file.

    Raises:
        BadInput: if it is no URDF of one tree of links; the message names the element.
    """
    root = read_xml(text, where, "a URDF")
    if any("xacro" in element.tag for element in root.iter() if isinstance(element.tag, str)):
        raise BadInput(f"{where}: expected a URDF, found a xacro file; write it out with `xacro FILE > robot.urdf`")
    links = [_link(element, where) for element in root.findall("link")]
    joints = [_joint(element, where) for element in root.findall("joint")]
    _refuse_repeated("link", [each.name for each in links], where)
    _refuse_repeated("joint", [each.name for each in joints], where)
    named = {link.name: link for link in links}
    base = _root(named, joints, where)
    hanging = {each.name: each for each in _sorted(base, joints)}
    for joint in joints:
        if joint.name not in hanging:
            raise BadInput(
                f"{where}: joint {joint.name!r}: expected a joint below the root link {base!r}, found one that is on a "
                f"closed chain, or below it; cut the chain at one of its joints"
            )
    return Urdf(root.get("name", "robot"), named, hanging, base)


def completed(text: str, where: str = WHERE) -> str:
    """Return a URDF's text with 0 for limits of effort and velocity that it does not state.

    Pinocchio, which the checker uses, refuses a limit without them. Here 0 means that they are not known.
    """
    root = read_xml(text, where, "a URDF")
    changed = False
    for joint in root.findall("joint"):
        if joint.get("type") not in ("revolute", "prismatic"):
            continue
        limit = joint.find("limit")
        if limit is None:  # the joint may be welded
            limit = ElementTree.SubElement(joint, "limit")
        for name in ("effort", "velocity"):
            if limit.get(name) is None:
                limit.set(name, "0")
                changed = True
    return ElementTree.tostring(root, encoding="unicode") if changed else text


def read_xml(text: str, where: str, what: str) -> ElementTree.Element:
    """Return the ``<robot>`` element of a URDF's or SRDF's text.

    Raises:
        BadInput: if the text is not such XML.
    """
    # A document type could define entities that unfold without bound.
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise BadInput(f"{where}: expected {what} without a document type, found <!DOCTYPE; remove it")
    try:
        root = ElementTree.fromstring(text.encode())
    except (ElementTree.ParseError, LookupError, ValueError) as error:  # the latter two: of an unknown encoding
        raise BadInput(f"{where}: expected {what}, found no XML: {error}") from None
    if root.tag != "robot":
        raise BadInput(f"{where}: expected {what} with the element <robot>, found <{root.tag}>")
    return root


def _link(element: ElementTree.Element, where: str) -> Link:
    name = _name(element, "link", where)
    at = f"{where}: link {name!r}"
    collisions = tuple(_geometry(each, at) for each in element.findall("collision"))
    return Link(name, collisions, len(element.findall("visual")))


def _geometry(collision: ElementTree.Element, at: str) -> Geometry:
    geometry = collision.find("geometry")
    shapes = [] if geometry is None else [each for each in geometry if isinstance(each.tag, str)]
    if not shapes:
        raise BadInput(f"{at}: expected <collision> with <geometry> of a shape, found none")
    shape, placement = shapes[0], _origin(collision, at)
    match shape.tag:
        case "mesh":
            name = shape.get("filename", "")
            if not name:
                raise BadInput(f"{at}: expected <mesh filename=..>, found no filename")
            x, y, z = _numbers(shape.get("scale"), UNSCALED, f"{at}: scale of the mesh")
            return Geometry("mesh", (), name, (x, y, z), placement)
        case "box":
            return Geometry("box", _sizes(shape, ("size",), at), "", UNSCALED, placement)
        case "sphere":
            return Geometry("sphere", _sizes(shape, ("radius",), at), "", UNSCALED, placement)
        case "cylinder" | "capsule":
            return Geometry(shape.tag, _sizes(shape, ("radius", "length"), at), "", UNSCALED, placement)
    raise BadInput(f"{at}: expected a box, cylinder, sphere, capsule or mesh, found <{shape.tag}>")


def _sizes(shape: ElementTree.Element, names: tuple[str, ...], at: str) -> tuple[float, ...]:
    sizes: list[float] = []
    for name in names:
        count = 3 if name == "size" else 1
        text = shape.get(name)
        numbers = _numbers(text, (0.0,) * count, f"{at}: {name} of the {shape.tag}")
        if min(numbers) <= 0.0:
            raise BadInput(f"{at}: expected {name} of the {shape.tag} above 0 m, found {text or 'none'}")
        sizes += numbers
    return tuple(sizes)


def _joint(element: ElementTree.Element, where: str) -> Joint:
    name = _name(element, "joint", where)
    at, kind = f"{where}: joint {name!r}", element.get("type", "")
    if kind not in _TYPES:
        raise BadInput(f"{at}: expected a type of {', '.join(_TYPES)}, found {kind!r}{did_you_mean(kind, _TYPES)}")
    ends = {}
    for end in ("parent", "child"):
        found = element.find(end)
        ends[end] = "" if found is None else found.get("link", "")
        if not ends[end]:
            raise BadInput(f"{at}: expected <{end} link=..>, found none")
    limit, mimic = element.find("limit"), element.find("mimic")
    return Joint(
        name,
        kind,
        ends["parent"],
        ends["child"],
        _origin(element, at),
        _axis(element, at) if kind in MOVING else np.zeros(3),
        _limits(limit, at) if kind in MOVING else None,
        _stated(limit, "velocity", at),
        _stated(limit, "effort", at),
        _mimic(mimic, at) if mimic is not None and kind in MOVING else None,
    )


def _axis(element: ElementTree.Element, at: str) -> Floats:
    found = element.find("axis")
    axis = np.array(_numbers(None if found is None else found.get("xyz"), (1.0, 0.0, 0.0), f"{at}: axis"))
    length = math.sqrt(float((axis * axis).sum()))
    if length < 1e-9:
        raise BadInput(f"{at}: expected an axis of some length, found {axis.tolist()}")
    unit: Floats = axis / length
    return unit


def _limits(limit: ElementTree.Element | None, at: str) -> tuple[float, float] | None:
    if limit is None or (limit.get("lower") is None and limit.get("upper") is None):
        return None
    return _number(limit, "lower", 0.0, at), _number(limit, "upper", 0.0, at)


def _stated(limit: ElementTree.Element | None, name: str, at: str) -> float:
    value = math.nan if limit is None or limit.get(name) is None else _number(limit, name, 0.0, at)
    return value if value > 0.0 else math.nan  # some exporters write 0 for what they do not know


def _mimic(mimic: ElementTree.Element, at: str) -> tuple[str, float, float]:
    followed = mimic.get("joint", "")
    if not followed:
        raise BadInput(f"{at}: expected <mimic joint=..>, found none")
    return followed, _number(mimic, "multiplier", 1.0, at), _number(mimic, "offset", 0.0, at)


def _origin(element: ElementTree.Element, at: str) -> Floats:
    origin = element.find("origin")
    if origin is None:
        return IDENTITY
    x, y, z = _numbers(origin.get("xyz"), (0.0, 0.0, 0.0), f"{at}: origin's xyz")
    roll, pitch, yaw = _numbers(origin.get("rpy"), (0.0, 0.0, 0.0), f"{at}: origin's rpy")
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr, x],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr, y],
            [-sp, cp * sr, cp * cr, z],
        ]
    ).reshape(12)


def _number(element: ElementTree.Element, name: str, default: float, at: str) -> float:
    return _numbers(element.get(name), (default,), f"{at}: {name}")[0]


def _numbers(text: str | None, default: tuple[float, ...], at: str) -> list[float]:
    if text is None:
        return list(default)
    try:
        numbers = [float(each) for each in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != len(default) or not all(map(math.isfinite, numbers)):
        expected = f"{len(default)} numbers" if len(default) > 1 else "a number"
        raise BadInput(f"{at}: expected {expected}, found {text!r}")
    return numbers


def _name(element: ElementTree.Element, what: str, where: str) -> str:
    name = element.get("name", "")
    if not name:
        raise BadInput(f"{where}: expected a name for each {what}, found one without")
    return name


def _refuse_repeated(what: str, names: list[str], where: str) -> None:
    for number, name in enumerate(names):
        if name in names[:number]:
            raise BadInput(f"{where}: expected different names, found two {what}s {name!r}")


def _root(links: dict[str, Link], joints: list[Joint], where: str) -> str:
    """Return the only link that no joint carries; each other one is carried by one joint."""
    carried: dict[str, str] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in links:
                raise BadInput(
                    f"{where}: joint {joint.name!r}: expected a link of the URDF, found {link!r}"
                    f"{did_you_mean(link, links)}"
                )
        if joint.child in carried:
            raise BadInput(
                f"{where}: link {joint.child!r}: expected one joint that carries it, found "
                f"{carried[joint.child]!r} and {joint.name!r}; a closed chain must be cut at one of them"
            )
        carried[joint.child] = joint.name
    if not links:
        raise BadInput(f"{where}: expected links, found none")
    roots = [name for name in links if name not in carried]
    if len(roots) != 1:
        found = ", ".join(map(repr, roots[:4])) or "none"
        raise BadInput(f"{where}: expected one link that no joint carries, found {found}; join them by fixed joints")
    return roots[0]


def _sorted(base: str, joints: list[Joint]) -> Iterator[Joint]:
    """Yield the joints depth first, those of one link in the order of the file."""
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    left: list[Any] = below.get(base, [])[::-1]
    while left:
        joint = left.pop()
        yield joint
        left += below.get(joint.child, [])[::-1]
