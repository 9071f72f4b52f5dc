"""Make the compact model of a robot and its scene from gathered texts: URDF, SRDF and meshes. No file is opened.

The kinds call `make_srdf` and `make_scene` in `derive_fields`, once where a file is read; nodes read the scene's text.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput, did_you_mean
from problems.robots.arm import BOX, CYLINDER, SOLID_COLUMNS, SPHERE, Arm, Scene
from problems.robots.chain import Chain, chain_of, variables_of
from problems.robots.fields import (
    AttachedBox,
    AttachedCylinder,
    AttachedMesh,
    AttachedSphere,
    Box,
    BoxObstacle,
    Cylinder,
    CylinderObstacle,
    MeshObstacle,
    MeshShape,
    Robot,
    Shape,
    Sphere,
    SphereObstacle,
    name_of,
    rotation_of,
)
from problems.robots.hulls import MOST_TRIANGLES, simplified
from problems.robots.loading import shape_name
from problems.robots.meshes import UNSCALED, Scale, decode_mesh, mesh_of, mesh_text
from problems.robots.pairs import Trees, adjacent, disabled_by_sampling
from problems.robots.reach import reach_of
from problems.robots.shapes import chained, cut_to_size, placed, primitive
from problems.robots.srdf import Srdf, pair_of, read_srdf, write_srdf
from problems.robots.trees import tree_of
from problems.robots.urdf import Geometry, Urdf, read_urdf

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
AnyObstacle = BoxObstacle | CylinderObstacle | SphereObstacle | MeshObstacle
AnyAttached = AttachedBox | AttachedCylinder | AttachedSphere | AttachedMesh

_LEAF = (0.012, 0.04)  # m, least and greatest radius up to which a leaf may hold several triangles
_LEAVES_ACROSS = 8  # radii of leaves in that of a piece
_MOST_LEAVES_ACROSS = 40  # the same for pieces as large as a room, so that they do not become millions of triangles
_EDGE = 2.4  # longest edge of a triangle, in radii of a leaf
_MOST_REFINED = 6000  # triangles of a mesh that replaces its hulls where these touch another piece always


@dataclass(frozen=True, eq=False)
class Piece:
    """The geometry of a link, an attached thing or a mesh obstacle.

    Attributes:
        name: the name of the link, thing or obstacle.
        body: the body with which it moves.
        soup: its triangles in the frame of the body, (n, 3, 3), before they are cut to size.
    """

    name: str
    body: int
    soup: Floats


@dataclass(frozen=True, eq=False)
class Parts:
    """A robot as read from its texts."""

    urdf: Urdf
    srdf: Srdf
    chain: Chain


def read_parts(robot: Robot) -> Parts:
    """Return the robot of a problem's fields.

    Raises:
        BadInput: if the texts cannot be used; the message names the field and the link or joint.
    """
    urdf, srdf = read_urdf(robot.urdf), read_srdf(robot.srdf)
    chain = chain_of(urdf, variables_of(robot, urdf, srdf), robot.fixed, robot.base.placement)
    return Parts(urdf, srdf, chain)


def make_srdf(robot: Robot) -> str:
    """Return the robot's SRDF; where it says nothing about pairs, with those found by sampling.

    So that planners and the checker leave out the same pairs.

    Raises:
        BadInput: see `read_parts`.
    """
    parts = read_parts(robot)
    if parts.srdf.says_pairs and robot.srdf is not None:
        return robot.srdf
    pieces = _refined(robot, parts, link_pieces(robot, parts))
    bodies, names = np.array([piece.body for piece in pieces], np.int64), tuple(piece.name for piece in pieces)
    disabled = disabled_by_sampling(parts.urdf, parts.chain, names, bodies, planted(pieces))
    return write_srdf(parts.urdf.name, disabled, robot.srdf)


def always_touching(robot: Robot, parts: Parts) -> list[tuple[str, str]]:
    """Return the pairs of links that are tested and collide in nearly every configuration."""
    pieces = _refined(robot, parts, link_pieces(robot, parts))
    bodies = np.array([piece.body for piece in pieces], np.int64)
    always = _touching_always(planted(pieces), _pairs_of_links(parts, pieces), bodies, parts.chain)
    return [(pieces[i].name, pieces[j].name) for i, j in always]


def make_arm(robot: Robot) -> Arm:
    """Return the compact model of a robot alone; see `make_scene`."""
    return make_scene(robot).arm


def make_scene(
    robot: Robot,
    obstacles: Sequence[AnyObstacle] = (),
    attached: Sequence[AnyAttached] = (),
    clearance: float = 0.0,
) -> Scene:
    """Return a robot among obstacles as the kernels read it.

    Pairs are those of ``robot.srdf``; see `make_srdf`.

    Raises:
        BadInput: if the texts cannot be used, or an attached thing names a link that is not there.
    """
    parts = read_parts(robot)
    pieces = _refined(robot, parts, link_pieces(robot, parts))
    links = len(pieces)
    meshes = [name_of(each, "obstacles", at) for at, each in enumerate(obstacles) if isinstance(each, MeshObstacle)]
    pieces += [_attached_piece(robot, parts, thing, number, meshes) for number, thing in enumerate(attached)]
    held = len(pieces)
    for number, obstacle in enumerate(obstacles):
        if isinstance(obstacle, MeshObstacle):
            soup = placed(obstacle.placement, _soup_of(obstacle, robot))
            pieces.append(Piece(name_of(obstacle, "obstacles", number), 0, soup))
    pairs = _pairs_of_links(parts, pieces[:links])
    pairs += _pairs_of_attached(pieces, links, held, attached)
    pairs += [(i, j) for i in range(links) for j in range(held, len(pieces)) if pieces[i].body != 0]
    trees = planted(pieces)
    solids = [(name_of(each, "obstacles", number), _solid(each)) for number, each in enumerate(obstacles)
              if not isinstance(each, MeshObstacle)]  # fmt: skip
    return Scene(
        arm=_arm(parts.chain, pieces, trees, sorted(pairs)),
        solids=np.array([row for _, row in solids]).reshape(-1, SOLID_COLUMNS),
        names=tuple(name for name, _ in solids),
        clearance=clearance,
    )


def _arm(chain: Chain, pieces: list[Piece], trees: Trees, pairs: list[tuple[int, int]]) -> Arm:
    own: list[list[Floats]] = [[] for _ in chain.bodies]
    for piece in pieces:
        own[piece.body].append(piece.soup.reshape(-1, 3))
    for body, placement in zip(chain.link_body, chain.link_placements, strict=True):
        own[body].append(placement.reshape(3, 4)[None, :, 3])  # frames of links count as points, for targets of poses
    return Arm(
        joints=chain.joints,
        bodies=chain.bodies,
        links=chain.links,
        pieces=tuple(piece.name for piece in pieces),
        link_body=chain.link_body,
        link_placements=chain.link_placements,
        parents=chain.parents,
        kinds=chain.kinds,
        variables=chain.variables,
        scales=chain.scales,
        placements=chain.placements,
        axes=chain.axes,
        limits=chain.limits,
        velocity=chain.velocity,
        acceleration=np.full(len(chain.joints), np.nan),
        effort=chain.effort,
        reach=reach_of(chain, [np.concatenate([np.empty((0, 3)), *each]) for each in own]),
        piece_body=np.array([piece.body for piece in pieces], np.int64),
        piece_root=trees.roots,
        spheres=trees.spheres,
        children=trees.children,
        triangles=trees.triangles,
        pairs=np.array(pairs, np.int64).reshape(-1, 2),
    )


# Pieces ---------------------------------------------------------------------------------------------------------------
def link_pieces(robot: Robot, parts: Parts, refined: set[str] | frozenset[str] = frozenset()) -> list[Piece]:
    """Return a piece for each link with collision geometry, in the order of the URDF.

    Args:
        robot: the fields, for the meshes.
        parts: the robot.
        refined: links whose meshes are used as they are, unless they are very large.
    """
    pieces = []
    for number, link in enumerate(parts.urdf.links.values()):
        soups = []
        for geometry in link.collisions:
            soup = _soup_of_link(robot, geometry, link.name in refined)
            placement = chained(parts.chain.link_placements[number], geometry.placement)
            soups.append(placed(placement, soup))
        if soups:
            pieces.append(Piece(link.name, int(parts.chain.link_body[number]), np.concatenate(soups)))
    return pieces


def _refined(robot: Robot, parts: Parts, pieces: list[Piece]) -> list[Piece]:
    """Return the links' pieces with exact meshes in place of hulls that always touch another piece.

    Such a pair would forbid every configuration, although the meshes may be apart.
    """
    bodies = np.array([piece.body for piece in pieces], np.int64)
    always = _touching_always(planted(pieces), _pairs_of_links(parts, pieces), bodies, parts.chain)
    if not always:
        return pieces
    return link_pieces(robot, parts, {pieces[each].name for pair in always for each in pair})


def _touching_always(
    trees: Trees, pairs: list[tuple[int, int]], bodies: Integers, chain: Chain
) -> list[tuple[int, int]]:
    if not pairs:
        return []
    always = trees.always_touching(np.array(pairs, np.int64), bodies, chain.frames(chain.random(100, 0)))
    return [pair for pair, is_always in zip(pairs, always, strict=True) if is_always]


def _soup_of_link(robot: Robot, geometry: Geometry, refined: bool) -> Floats:
    """Return the triangles of a collision element in its own frame."""
    if geometry.shape != "mesh":
        return primitive(geometry.shape, geometry.size)
    return _mesh_soup(robot, geometry.mesh, geometry.scale, refined)


def _mesh_soup(robot: Robot, name: str, scale: Scale, refined: bool = False) -> Floats:
    vertices, triangles = mesh_of(robot.meshes, name, scale)
    if len(triangles) <= (_MOST_REFINED if refined else MOST_TRIANGLES):
        soup: Floats = vertices[triangles]
        return soup
    return _hulls_of(mesh_text(robot.meshes, name, scale))


@lru_cache(maxsize=128)  # robots use a mesh several times, and `make_scene` those of `make_srdf` again
def _hulls_of(text: str) -> Floats:
    vertices, triangles = decode_mesh(text)
    hulls = simplified(vertices[triangles])
    hulls.setflags(write=False)
    return hulls


def _soup_of(shape: Shape, robot: Robot) -> Floats:
    """Return the triangles of an obstacle or attached thing in its own frame."""
    match shape:
        case Box():
            return primitive("box", shape.size)
        case Cylinder():
            return primitive("cylinder", (shape.radius, shape.length))
        case Sphere():
            return primitive("sphere", (shape.radius,))
        case MeshShape():
            x, y, z = shape.scale
            return _mesh_soup(robot, shape_name(shape.file, (x, y, z)), UNSCALED)


def _attached_piece(robot: Robot, parts: Parts, thing: AnyAttached, number: int, meshes: Sequence[str]) -> Piece:
    """Return the piece of an attached thing; ``meshes`` are the names of mesh obstacles."""
    chain, name = parts.chain, name_of(thing, "attached", number)
    _refuse_unknown(f"attached[{number}].link", thing.link, "a link of the URDF", chain.links)
    for each in thing.may_touch:
        _refuse_unknown(
            f"attached[{number}].may_touch", each, "links of the URDF or mesh obstacles", [*chain.links, *meshes]
        )
    at = chain.links.index(thing.link)
    placement = chained(chain.link_placements[at], thing.placement)
    return Piece(name, int(chain.link_body[at]), placed(placement, _soup_of(thing, robot)))


def _refuse_unknown(field: str, name: str, expected: str, known: Sequence[str]) -> None:
    if name not in known:
        raise BadInput(f"{field}: expected {expected}, found {name!r}{did_you_mean(name, known)}")


def planted(pieces: list[Piece]) -> Trees:
    """Return the sphere trees of all pieces, one after another in the same arrays."""
    roots, spheres, children, triangles = [], [np.empty((0, 4))], [np.empty((0, 2), np.int64)], [np.empty((0, 9))]
    first, count = 0, 0
    for piece in pieces:
        points = piece.soup.reshape(-1, 3)
        radius = float(np.linalg.norm(np.ptp(points, axis=0))) / 2
        leaf = max(float(np.clip(radius / _LEAVES_ACROSS, *_LEAF)), radius / _MOST_LEAVES_ACROSS)
        own, below, soup = tree_of(cut_to_size(piece.soup, _EDGE * leaf), leaf)
        leaves = below[:, :1] < 0
        offsets = np.where(leaves, -count, first)
        roots.append(first)
        spheres.append(own)
        children.append(np.concatenate([below[:, :1] + offsets, below[:, 1:]], axis=1))
        triangles.append(soup)
        first, count = first + len(own), count + len(soup)
    every = np.concatenate(spheres), np.concatenate(children), np.concatenate(triangles)
    return Trees(np.array(roots, np.int64), *every)


# Pairs and solids -----------------------------------------------------------------------------------------------------
def _pairs_of_links(parts: Parts, pieces: list[Piece]) -> list[tuple[int, int]]:
    """Return the pairs of links that are tested: not on one body, not across one joint, not disabled."""
    beside, pairs = adjacent(parts.urdf), []
    for i, one in enumerate(pieces):
        for j in range(i + 1, len(pieces)):
            other = pieces[j]
            if one.body == other.body or pair_of(one.name, other.name) in beside:
                continue
            if not parts.srdf.is_disabled(one.name, other.name):
                pairs.append((i, j))
    return pairs


def _pairs_of_attached(
    pieces: list[Piece], links: int, held: int, attached: Sequence[AnyAttached]
) -> list[tuple[int, int]]:
    """Return the pairs of attached things with links, with mesh obstacles and with each other."""
    pairs = set()
    for number, thing in enumerate(attached):
        own = links + number
        for other, piece in enumerate(pieces):
            is_allowed = piece.name in thing.may_touch or (
                links <= other < held and pieces[own].name in attached[other - links].may_touch
            )
            if piece.body != pieces[own].body and not is_allowed:
                pairs.add((min(own, other), max(own, other)))
    return list(pairs)


def _solid(shape: Shape) -> Floats:
    """Return a row of `Scene.solids`."""
    match shape:
        case Box():
            kind, half = BOX, np.array(shape.size) / 2
        case Cylinder():
            kind, half = CYLINDER, np.array([shape.radius, shape.radius, shape.length / 2])
        case Sphere():
            kind, half = SPHERE, np.full(3, shape.radius)
        case _:
            raise AssertionError("meshes are pieces")
    return np.concatenate([[kind], rotation_of(shape.quaternion).T.reshape(9), shape.position, half])
