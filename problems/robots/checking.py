"""Say what is wrong with a robot's description, and how to mend it: all of it, not only what comes first."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from problems.errors import BadInput
from problems.robots.chain import chain_of
from problems.robots.fields import Robot
from problems.robots.loading import Finder, gather_meshes, read_text, srdf_beside, uses_of_meshes
from problems.robots.making import Parts, always_touching
from problems.robots.meshes import mesh_of, read_mesh
from problems.robots.pairs import adjacent
from problems.robots.srdf import Srdf, pair_of, read_srdf
from problems.robots.urdf import MOVING, Joint, Urdf, read_urdf

_LARGEST = 5.0  # m; a larger mesh was probably drawn in millimetres
_MILLIMETRES = 1000.0


@dataclass(frozen=True)
class Finding:
    """Something about a robot's description.

    Attributes:
        text: what it is and how to mend it.
        is_wrong: whether it keeps the robot from being used as it is; otherwise it is only worth knowing.
    """

    text: str
    is_wrong: bool = True


def findings(path: Path, packages: list[Path] | None = None, srdf: Path | None = None) -> list[Finding]:
    """Return what is wrong or worth knowing about a URDF, most important first.

    Args:
        path: the URDF.
        packages: folders where ``package://`` looks; see `Finder`.
        srdf: its SRDF; None for the one beside a robot of example-robot-data.
    """
    try:
        text = read_text(path, str(path))
        urdf = read_urdf(text, str(path))
    except BadInput as error:
        return [Finding(str(error))]
    found = list(_of_joints(urdf))
    finder = Finder(path, packages)
    meshes = list(_of_meshes(urdf, finder))
    found += meshes
    srdf = srdf_beside(path) if srdf is None else srdf
    semantics = Srdf()
    if srdf is not None:
        try:
            semantics = read_srdf(read_text(srdf, str(srdf)), str(srdf))
            found += _of_srdf(urdf, semantics)
        except BadInput as error:
            found.append(Finding(str(error)))
    if not any(each.is_wrong for each in found):
        found += _of_touching(text, urdf, semantics, finder)
    found += _of_links(urdf)
    return sorted(found, key=lambda each: not each.is_wrong)


def _of_joints(urdf: Urdf) -> Iterator[Finding]:
    for joint in urdf.joints.values():
        at = f"joint {joint.name!r}"
        if joint.kind in ("floating", "planar"):
            yield Finding(f'{at}: type {joint.kind} cannot move here; weld it by type="fixed", or replace it by joints '
                          "of one axis each")  # fmt: skip
        elif joint.mimic is not None:
            yield _of_mimic(joint, urdf)
        elif joint.kind in MOVING:
            yield from _of_limits(joint, at)


def _of_limits(joint: Joint, at: str) -> Iterator[Finding]:
    if joint.kind != "continuous":
        if joint.limits is None:
            mend = 'state <limit lower=".." upper=".."/>'
            mend += ', or make it type="continuous"' if joint.kind == "revolute" else ""
            yield Finding(f"{at}: has no limits; {mend}")
        elif not joint.limits[0] < joint.limits[1]:
            yield Finding(
                f"{at}: its limits {joint.limits[0]:g} and {joint.limits[1]:g} leave no room; mend them, or weld it by "
                'type="fixed"'
            )
    if np.isnan(joint.velocity):
        yield Finding(f'{at}: has no velocity limit; state <limit velocity=".."/> to retime its motions', False)


def _of_mimic(joint: Joint, urdf: Urdf) -> Finding:
    followed, multiplier, offset = joint.mimic or ("", 1.0, 0.0)
    at = f"joint {joint.name!r}"
    if followed not in urdf.joints or urdf.joints[followed].kind not in MOVING:
        return Finding(f"{at}: mimics {followed!r}, which is no joint that moves; name another, or remove <mimic>")
    return Finding(f"{at}: follows {followed!r}: {multiplier:g} times its value plus {offset:g}; no variable", False)


def _of_meshes(urdf: Urdf, finder: Finder) -> Iterator[Finding]:
    seen = set()
    for link, geometry in uses_of_meshes(urdf):
        if (geometry.mesh, geometry.scale) in seen:
            continue
        seen.add((geometry.mesh, geometry.scale))
        try:
            path = finder.find(geometry.mesh, f"link {link!r}")
            vertices, _ = read_mesh(path, geometry.scale, f"link {link!r}")
        except BadInput as error:
            yield Finding(str(error))
            continue
        extent = float(np.ptp(vertices, axis=0).max())
        if extent > _LARGEST:
            scale = " ".join(f"{each / _MILLIMETRES:g}" for each in geometry.scale)
            yield Finding(f'link {link!r}: the mesh {path} is {extent:.3g} m long; if it is in mm, say scale="{scale}"')


def _of_srdf(urdf: Urdf, srdf: Srdf) -> Iterator[Finding]:
    unknown = sorted({link for pair in srdf.disabled for link in pair if link not in urdf.links})
    if unknown:
        yield Finding(f"SRDF: disables collisions of {len(unknown)} unknown links, such as {unknown[0]!r}", False)
    for group in srdf.groups:
        try:
            srdf.joints_of(group, urdf)
        except BadInput as error:
            yield Finding(f"SRDF: group {group!r} cannot be planned for: {error}", False)


def _of_touching(text: str, urdf: Urdf, srdf: Srdf, finder: Finder) -> Iterator[Finding]:
    """Yield the links that collide in every configuration; only for a robot without other faults."""
    if not urdf.movable:
        yield Finding("no joint moves")
        return
    robot = Robot(urdf=text, meshes=gather_meshes(urdf, finder))
    parts = Parts(urdf, srdf, chain_of(urdf, urdf.movable, {}))
    beside = adjacent(urdf)
    pairs = [pair for pair in always_touching(robot, parts) if pair_of(*pair) not in beside]
    if pairs and not srdf.says_pairs:
        one, other = pairs[0]
        yield Finding(
            f"{len(pairs)} pairs of links collide in every configuration, such as {one!r} and {other!r}; they are left "
            "out, as no SRDF says which pairs matter; write one with --srdf OUT",
            False,
        )
        return
    for one, other in pairs:
        yield Finding(
            f"links {one!r} and {other!r} collide in every configuration; say "
            f'<disable_collisions link1="{one}" link2="{other}" reason="Always"/> in the SRDF'
        )


def _of_links(urdf: Urdf) -> Iterator[Finding]:
    bare = [link.name for link in urdf.links.values() if link.visuals and not link.collisions]
    if bare:
        yield Finding(
            f"{len(bare)} links are drawn but have no <collision>, so nothing can touch them: {', '.join(bare[:6])}"
            f"{' …' if len(bare) > 6 else ''}",
            False,
        )
    if not any(link.collisions for link in urdf.links.values()):
        yield Finding("no link has <collision>: nothing would ever collide; copy <visual> to <collision>")


def triangles_of(robot: Robot, mesh: str, scale: tuple[float, float, float]) -> int:
    """Return the number of triangles of a gathered mesh."""
    return len(mesh_of(robot.meshes, mesh, scale)[1])
