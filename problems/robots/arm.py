"""The compact model of a robot and its scene: plain arrays, which the compiled kernels read and which travel as a text.

A *body* is what one joint moves: all links that are rigidly attached to each other. Body 0 is the world with everything
that stands still; parents come before their children. A *piece* is the geometry of one link, of one attached thing or
of one mesh obstacle: triangles in the frame of its body, under a tree of bounding spheres. A *variable* is a number of
a configuration.

Every sphere contains all triangles under it, and the triangles contain the link's collision geometry. So what keeps
clear of the spheres, or of the triangles, keeps clear of the link.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from problems.robots.packing import Arrays, pack, unpack

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

FIXED, REVOLUTE, PRISMATIC = 0, 1, 2
"""The kinds of joints in `Arm.kinds`. Only body 0 is fixed."""
BOX, CYLINDER, SPHERE = 0, 1, 2
"""The kinds of solids in `Scene.solids`."""
SOLID_COLUMNS = 16

ARM_ARRAYS = (
    "parents",
    "kinds",
    "variables",
    "scales",
    "placements",
    "axes",
    "limits",
    "reach",
    "piece_body",
    "piece_root",
    "spheres",
    "children",
    "triangles",
    "pairs",
)
"""The fields of `Arm` that kernels read, in the order of `Arm.arrays`."""
SCENE_ARRAYS = (*ARM_ARRAYS, "solids", "numbers")
"""The arrays of a scene in the order of `Scene.arrays`; ``numbers`` has shape (1,): the clearance, m."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A robot with its pieces: B bodies, n variables, L pieces, S spheres, T triangles, P pairs, K links.

    A placement is a row-major 3×4 matrix [R | p]. The frame of body b is that of its parent, then ``placements[b]``,
    then the joint's motion: a turn about, or a shift along, ``axes[b]`` by

        scales[b, 0] * q[variables[b]] + scales[b, 1]

    Attributes:
        joints: the names of the variables, which are those of the joints; n of them.
        bodies: the name of each body's joint; ``"world"`` for body 0.
        links: the names of all links of the URDF.
        pieces: the names of the pieces: of the link, the attached thing or the obstacle.
        link_body: the body of each link, shape (K,).
        link_placements: each link's frame in the frame of its body, shape (K, 12).
        parents: the body that carries each body, shape (B,); -1 for body 0.
        kinds: `FIXED` (body 0), `REVOLUTE` or `PRISMATIC`, shape (B,).
        variables: the variable that moves each body, shape (B,); -1 for body 0. Mimic joints share a variable.
        scales: multiplier and offset of the variable, shape (B, 2); (1, 0) but for mimic joints.
        placements: the joint's frame at zero in the frame of the parent's body, shape (B, 12). The robot's base is
            included, so the frame of body 0 is the world's.
        axes: unit vectors in the joint's frame, shape (B, 3); 0 for body 0.
        limits: lowest and highest value of each variable, rad or m, shape (n, 2); -2π and 2π for continuous joints.
        velocity: the URDF's limit of each variable, rad/s or m/s, shape (n,); NaN if it states none.
        acceleration: the same, rad/s² or m/s²; NaN, as a URDF has none.
        effort: the same, N m or N.
        reach: the most that any point of body b moves when variable v changes by one unit, over all configurations
            within limits, m per rad or m per m, shape (B, n); 0 where v does not move b.
        piece_body: the body of each piece, shape (L,).
        piece_root: the root of each piece's tree, an index of ``spheres``, shape (L,).
        spheres: centre in the frame of the body, and radius, m, shape (S, 4).
        children: first child and number of children of each sphere, shape (S, 2). For a leaf: -(first triangle) - 1 and
            the number of triangles.
        triangles: three corners in the frame of the body, m, shape (T, 9).
        pairs: the pieces that are tested against each other, shape (P, 2), the lower number first.
    """

    joints: tuple[str, ...]
    bodies: tuple[str, ...]
    links: tuple[str, ...]
    pieces: tuple[str, ...]
    link_body: Integers
    link_placements: Floats
    parents: Integers
    kinds: Integers
    variables: Integers
    scales: Floats
    placements: Floats
    axes: Floats
    limits: Floats
    velocity: Floats
    acceleration: Floats
    effort: Floats
    reach: Floats
    piece_body: Integers
    piece_root: Integers
    spheres: Floats
    children: Integers
    triangles: Floats
    pairs: Integers

    def arrays(self) -> list[NDArray[np.generic]]:
        """Return the arrays that kernels read, in the order of `ARM_ARRAYS`."""
        return [getattr(self, name) for name in ARM_ARRAYS]

    def to_text(self) -> str:
        """Return the model as a text; `from_text` returns the same arrays, bit for bit."""
        return pack({each.name: getattr(self, each.name) for each in fields(self)})

    @staticmethod
    def from_text(text: str) -> Arm:
        """Return the model that `to_text` wrote.

        Raises:
            ValueError: if it is another text.
        """
        return _arm_of(unpack(text))

    def link(self, name: str) -> tuple[int, Floats]:
        """Return the body of a link, and the link's frame in it, shape (12,).

        Raises:
            KeyError: if there is no such link.
        """
        if name not in self.links:
            raise KeyError(name)
        number = self.links.index(name)
        return int(self.link_body[number]), self.link_placements[number]


@dataclass(frozen=True, eq=False)
class Scene:
    """A robot among obstacles, ready for the kernels; O solids.

    Attributes:
        arm: the robot. Its pieces include the attached things, and mesh obstacles on body 0.
        solids: shape (O, 16): kind (`BOX`, `CYLINDER`, `SPHERE`), the rotation from the world into the solid's frame,
            row-major (9), centre (3), half sizes (3). A cylinder's are radius, radius, half length; a sphere's are
            three times its radius. Every piece that is not on body 0 is tested against every solid.
        names: the names of the solids.
        clearance: the least distance that everything must keep, m.
    """

    arm: Arm
    solids: Floats
    names: tuple[str, ...]
    clearance: float

    def arrays(self) -> list[NDArray[np.generic]]:
        """Return the arrays that kernels read, in the order of `SCENE_ARRAYS`: entries of an operator's table."""
        return [*self.arm.arrays(), self.solids, np.array([self.clearance])]

    def to_text(self) -> str:
        """Return the scene as a text; `from_text` returns the same arrays, bit for bit."""
        arm = {each.name: getattr(self.arm, each.name) for each in fields(Arm)}
        return pack({**arm, "solids": self.solids, "names": self.names, "clearance": np.array([self.clearance])})

    @staticmethod
    def from_text(text: str) -> Scene:
        """Return the scene that `to_text` wrote.

        Raises:
            ValueError: if it is another text.
        """
        parts = unpack(text)
        arm = _arm_of(parts)
        if not {"solids", "names", "clearance"} <= parts.keys():
            raise ValueError("expected the text of a scene, found another text")
        return Scene(arm, parts["solids"], parts["names"], float(parts["clearance"][0]))

    def with_clearance(self, clearance: float) -> Scene:
        """Return the same scene with another clearance, m."""
        return replace(self, clearance=clearance)


def _arm_of(parts: Arrays) -> Arm:
    missing = [each.name for each in fields(Arm) if each.name not in parts]
    if missing:
        raise ValueError(f"expected the text of a robot, found one without {missing[0]}")
    return Arm(**{each.name: parts[each.name] for each in fields(Arm)})
