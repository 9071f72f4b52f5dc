"""Read and write SRDF texts: groups of joints, states of groups, and pairs of links that need no collision check."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

from problems.errors import BadInput, did_you_mean
from problems.robots.urdf import Urdf, read_xml

WHERE = "robot.srdf"
Pair = tuple[str, str]  # names of links, sorted
_DEEPEST = 50  # groups within groups


def pair_of(one: str, other: str) -> Pair:
    """Return two links as a pair, which has no order."""
    return (one, other) if one < other else (other, one)


@dataclass(frozen=True)
class Srdf:
    """The contents of an SRDF.

    Attributes:
        groups: each group's elements in the order of the file: (tag, attributes), of joint, link, chain and group.
        states: by group and name of the state, the value of each joint, rad or m.
        disabled: the pairs of links that are not tested against each other, with the reason.
        without_default: links that are tested only against those of ``enabled``.
        enabled: the pairs that are tested in spite of ``without_default``.
    """

    groups: Mapping[str, list[tuple[str, dict[str, str]]]] = field(default_factory=dict)
    states: Mapping[str, dict[str, dict[str, float]]] = field(default_factory=dict)
    disabled: Mapping[Pair, str] = field(default_factory=dict)
    without_default: frozenset[str] = frozenset()
    enabled: frozenset[Pair] = frozenset()

    @property
    def says_pairs(self) -> bool:
        """Whether it says anything about pairs; otherwise they are found by sampling."""
        return bool(self.disabled or self.without_default)

    def is_disabled(self, one: str, other: str) -> bool:
        """Return whether two links are not tested against each other."""
        pair = pair_of(one, other)
        if pair in self.enabled:
            return False
        return pair in self.disabled or one in self.without_default or other in self.without_default

    def joints_of(self, group: str, urdf: Urdf) -> list[str]:
        """Return the joints of a group that may be variables, in the order in which the group names them.

        A chain's joints come from its base to its tip. A link stands for the joint that carries it.

        Raises:
            BadInput: if there is no such group, or it names what the URDF does not have, or no joint of it moves.
        """
        names = list(dict.fromkeys(self._joints(group, urdf, (), set())))
        moving = [name for name in names if name in urdf.movable]
        if not moving:
            raise BadInput(
                f"robot.group: expected a group with joints that move, found {group!r} with "
                f"{', '.join(names[:6]) or 'none'}; the SRDF has {', '.join(self.groups)}"
            )
        return moving

    def _joints(self, group: str, urdf: Urdf, within: tuple[str, ...], done: set[str]) -> list[str]:
        """Return the joints of a group but for those of the groups ``done``, which are named already.

        Without these, a few groups that each name another one twice would have joints without number.
        """
        if group not in self.groups:
            raise BadInput(
                f"robot.group: expected one of {', '.join(self.groups) or 'no groups'} of the SRDF, found {group!r}"
                f"{did_you_mean(group, self.groups)}"
            )
        if group in within:
            raise BadInput(f"{WHERE}: group {group!r}: expected other groups in it, found the group itself")
        if group in done:
            return []
        if len(within) > _DEEPEST:
            raise BadInput(f"{WHERE}: group {group!r}: expected it within at most {_DEEPEST} others, found more")
        names: list[str] = []
        for tag, own in self.groups[group]:
            if tag == "group":
                names += self._joints(own.get("name", ""), urdf, (*within, group), done)
            elif tag == "chain":
                names += _chain(group, own, urdf)
            elif tag == "joint":
                names += [_known(group, "joint", own.get("name", ""), urdf.joints)]
            else:
                link = _known(group, "link", own.get("name", ""), urdf.links)
                names += [urdf.above[link].name] if link in urdf.above else []
        done.add(group)
        return names


def _chain(group: str, own: dict[str, str], urdf: Urdf) -> list[str]:
    base = _known(group, "link", own.get("base_link", ""), urdf.links)
    tip = _known(group, "link", own.get("tip_link", ""), urdf.links)
    way = urdf.way_to(tip)
    links = [urdf.root, *(joint.child for joint in way)]
    if base not in links:
        raise BadInput(
            f"{WHERE}: group {group!r}: expected a chain whose base carries its tip, found {base!r} and {tip!r}"
        )
    return [joint.name for joint in way[links.index(base) :]]


def _known(group: str, what: str, name: str, known: Mapping[str, object]) -> str:
    if name not in known:
        raise BadInput(
            f"{WHERE}: group {group!r}: expected a {what} of the URDF, found {name!r}{did_you_mean(name, known)}"
        )
    return name


def read_srdf(text: str | None, where: str = WHERE) -> Srdf:
    """Return what an SRDF's text says; an empty `Srdf` for None.

    Raises:
        BadInput: if it is no SRDF.
    """
    if text is None:
        return Srdf()
    root = read_xml(text, where, "an SRDF")
    groups = {
        each.get("name", ""): [
            (part.tag, dict(part.attrib)) for part in each if part.tag in ("joint", "link", "chain", "group")
        ]
        for each in root.findall("group")
    }
    states: dict[str, dict[str, dict[str, float]]] = {}
    for each in root.findall("group_state"):
        states.setdefault(each.get("group", ""), {})[each.get("name", "")] = _state(each, where)
    disabled = {_pair(each, where): each.get("reason", "") for each in root.findall("disable_collisions")}
    alone = frozenset(each.get("link", "") for each in root.findall("disable_default_collisions"))
    enabled = frozenset(_pair(each, where) for each in root.findall("enable_collisions"))
    return Srdf(groups, states, disabled, alone, enabled)


def _state(element: ElementTree.Element, where: str) -> dict[str, float]:
    values: dict[str, float] = {}
    for joint in element.findall("joint"):
        try:
            # A joint of several degrees of freedom has several values; it cannot move here, so its state is of no use.
            values[joint.get("name", "")] = float(joint.get("value", "").split()[0])
        except (ValueError, IndexError):
            raise BadInput(
                f"{where}: state {element.get('name')!r}: expected numbers, found {joint.get('value')!r} of "
                f"{joint.get('name')!r}"
            ) from None
    return values


def _pair(element: ElementTree.Element, where: str) -> Pair:
    one, other = element.get("link1"), element.get("link2")
    if not one or not other:
        raise BadInput(f"{where}: expected <{element.tag} link1=.. link2=..>, found {dict(element.attrib)}")
    return pair_of(one, other)


def write_srdf(name: str, disabled: Mapping[Pair, str], before: str | None = None) -> str:
    """Return an SRDF's text with the pairs, sorted.

    Args:
        name: the robot's name.
        disabled: the pairs and the reason of each, such as ``Adjacent``.
        before: an SRDF whose groups and states are kept; it says nothing of pairs.
    """
    lines = list(_lines(disabled))
    if before is None:
        return "\n".join(['<?xml version="1.0"?>', f"<robot name={quoteattr(name)}>", *lines, "</robot>", ""])
    head, end, tail = before.rpartition("</robot>")
    if not end:  # an element without content
        root = read_xml(before, WHERE, "an SRDF")
        return write_srdf(root.get("name", name), disabled)
    return head.rstrip() + "\n" + "\n".join(lines) + "\n" + end + tail


def _lines(disabled: Mapping[Pair, str]) -> Iterable[str]:
    for (one, other), reason in sorted(disabled.items()):
        attributes = f"link1={quoteattr(one)} link2={quoteattr(other)} reason={quoteattr(reason)}"
        yield f"  <disable_collisions {attributes}/>"
