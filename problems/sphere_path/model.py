"""The model of sphere-path: a path in configuration space that crosses no obstacle, or as few as possible."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe, Replacement
from problems.angles import WithAngles, in_unit
from problems.digests import digest
from problems.errors import BadInput
from problems.plane import CONTACT, Obstacle
from problems.problem import CodedProblem, Solution
from problems.sphere_path import cells, making
from problems.sphere_path.random_world import Random, random_spheres
from problems.sphere_path.space import Space, length_of
from problems.sphere_path.vehicle import Mesh, Vehicle, dimensions_of, gathered
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.bit_string import BitString
    from genetics.operators import Operator

Floats = NDArray[np.float64]
Place = Annotated[float, Field(ge=-1e6, le=1e6)]
Axes = Annotated[list[Place], Field(min_length=2, max_length=7)]

_FLIPS = 8.0  # bits that the tuned recipe changes in an offspring, on average


class SpherePathModel(CodedProblem, WithAngles):
    """The fields, coding, recipe, fitness and decoding; `SpherePath` adds what verifies and shows solutions."""

    about: ClassVar[str] = "a path among spheres in a configuration space of 2 to 7 dimensions"
    template: ClassVar[str] = """\
kind = "sphere-path"
# unit = "deg"                  # of a vehicle's angles; "rad" if not given
start = [0.5, 0.5, 0.5]         # one number an axis: 2 to 7 of them
goal = [9.5, 9.5, 9.5]
bounds = [[0.0, 10.0], [0.0, 10.0], [0.0, 10.0]]   # [least, greatest] of each axis
nodes = 2                       # between start and goal
bits = 8                        # of each of their components
# code = "gray"                 # or "binary"; if not given, the recipe's
# periodic = [false, false, true]   # axes whose ends are the same place, as of angles
length_weight = 0.5             # of two paths that cross as many, the shorter one is better
# clearance = 0.1               # that the path, or the vehicle on it (m), keeps from obstacles; 0 if not given

spheres = [                     # centre, then radius
    [5.0, 5.0, 5.0, 2.5],
    [2.5, 7.0, 3.0, 2.0],
    [7.5, 3.0, 7.0, 2.0],
    [6.0, 8.0, 8.0, 1.5],
]

# [random]                      # instead of spheres
# seed = 1
# count = 40
# radius = [0.5, 2.0]
# corridor = 2                  # places of a hidden path that stays free
# clearance = 0.1

# [vehicle]                     # instead of spheres: what moves; axes are x, y (, heading) or x, y, z (, yaw)
# vertices = [[-0.4, -0.2], [0.4, -0.2], [0.4, 0.2], [-0.4, 0.2]]   # m; or radius = 0.3; or mesh.file = "body.stl"
# [[obstacles]]                 # in the plane; in space: [mesh] file = "room.obj"
# shape = "box"
# center = [4.0, 2.0]           # m
# size = [0.4, 3.0]             # m

[run]                           # what the command line does not say
topology = "torus 4x4"
seed = 1
target = 0.03                   # nothing crossed, and a detour of at most 1.1; else the first path that is free will do
"""
    # The oracle's bounds are those of few special cases, and of spheres that cover more than the collisions.
    oracle_decides: ClassVar[bool] = False
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    start: Axes = quantity("m or rad", "where the path begins, one number an axis")
    goal: Axes = quantity("m or rad", "where it ends")
    bounds: Annotated[list[tuple[Place, Place]], Field(min_length=2, max_length=7)] = quantity(
        "m or rad", "[least, greatest] of each axis"
    )
    nodes: int = quantity("", "m, places between start and goal", default=4, ge=1, le=200)
    bits: int = quantity("bit", "p, bits of each component of a node", default=8, ge=1, le=62)
    periodic: list[bool] | None = quantity("", "which axes are periodic, as angles; none if not given", default=None)
    length_weight: float = quantity(
        "",
        "w: a detour of length x costs w·x/(x + the diagonal of the bounds); below 1, so crossings count first",
        default=0.0,
        ge=0,
        lt=1,
    )
    clearance: float = quantity(
        "m, or as the axes",
        "how far a vehicle keeps from obstacles or, without a vehicle, the path from spheres",
        default=0.0,
        ge=0,
        le=1e6,
    )
    spheres: list[Annotated[list[Place], Field(min_length=3, max_length=8)]] | None = quantity(
        "as the axes", "obstacles: [centre.., radius]", default=None, max_length=cells.MOST_SPHERES
    )
    random: Random | None = quantity("", "random obstacles, instead of spheres", default=None)
    vehicle: Vehicle | None = quantity("", "what moves in a world, instead of spheres", default=None)
    obstacles: list[Obstacle] = quantity("", "obstacles of a vehicle in the plane", default_factory=list)
    mesh: Mesh | None = quantity("", "the obstacle of a vehicle in space", default=None)
    accuracy: float = quantity(
        "m", "how far beyond the configurations in collision their spheres may reach", default=0.1, gt=0, le=1e6
    )
    hierarchy: str | None = quantity(
        "", "the spheres made from the vehicle and its obstacles when the file is read; do not write it", default=None
    )
    hierarchy_of: str | None = quantity("", "digest of what the spheres were made from; do not write it", default=None)

    @classmethod
    def from_degrees(cls, fields: dict[str, Any], problem: Mapping[str, Any]) -> dict[str, Any]:
        """Convert also the axes along which a vehicle turns; see `WithAngles.from_degrees`."""
        if not isinstance(problem.get("vehicle"), dict):
            raise BadInput('unit: expected "rad": only the axes of a vehicle may be angles, found "deg"')
        read = super().from_degrees(fields, problem)
        # Angles come after the translations.
        first = dimensions_of(problem.get("mesh"), problem["vehicle"].get("mesh"))
        for name in {"start", "goal", "bounds"} & read.keys():
            if isinstance(axes := read[name], list):
                turned = [in_unit("rad", each, f"{name}[{axis}]") for axis, each in enumerate(axes[first:], first)]
                read[name] = [*axes[:first], *turned]
        return read

    @classmethod
    def gather(cls, fields: dict[str, Any], folder: Path) -> dict[str, Any]:
        """Replace the names of mesh files with their triangles."""
        return gathered(fields, folder)

    @classmethod
    def derive_fields(cls, fields: dict[str, Any]) -> dict[str, Any]:
        """Fill in the spheres of a vehicle; spheres that were made from other fields are made anew."""
        if fields.get("vehicle") is None:
            return {name: value for name, value in fields.items() if name not in ("hierarchy", "hierarchy_of")}
        # A clearance of 0 is no part of the digest: problems from before there was such a field keep their digests.
        clearance = [fields["clearance"]] if fields.get("clearance") else []
        made_of = digest([fields.get(name) for name in making.SHAPING] + clearance)
        if fields.get("hierarchy_of") == made_of:
            return fields
        fields = {name: value for name, value in fields.items() if name != "hierarchy"}
        try:
            # The fields are validated first: spheres are only made of a problem without errors.
            problem = cls.model_validate_json(json.dumps(fields), strict=True)
        except ValidationError:
            return fields  # the caller validates the fields again, which raises the error
        return fields | {"hierarchy": problem.cells_code, "hierarchy_of": made_of}

    @cached_property
    def space(self) -> Space:
        """The box of configurations; angles of a vehicle count as arcs of its farthest point."""
        scale = np.ones(len(self.start))
        if self.vehicle is not None:
            # The first two or three axes are translations in m, the others angles.
            scale[2 if self.mesh is None else 3 :] = self.vehicle.reach
        periodic = self.periodic or [False] * len(self.start)
        return Space(np.array(self.bounds), scale, np.array(periodic))

    @cached_property
    def ends(self) -> tuple[Floats, Floats]:
        """Start and goal, as lengths."""
        return np.array(self.start) * self.space.scale, np.array(self.goal) * self.space.scale

    @property
    def straight(self) -> Floats:
        """The straight path, as lengths, unwrapped, shape (2, axes)."""
        start, goal = self.ends
        return np.stack([start, start + self.space.shorter(goal - start)])

    @cached_property
    def obstacle_spheres(self) -> Floats:
        """All obstacles, shape (n, axes + 1): centre and radius, as lengths."""
        if self.spheres is not None:
            return np.array(self.spheres, np.float64).reshape(-1, len(self.start) + 1)
        if self.random is not None:
            return random_spheres(self.random, self.space, *self.ends)
        return cells.spheres_of(self.cells_code, self.space)

    @property
    def forbidden_spheres(self) -> Floats:
        """The spheres that a path must not enter, shape (n, axes + 1): obstacles grown by the clearance.

        Spheres that are made from a vehicle and its obstacles include its clearance already.
        """
        if self.vehicle is not None:
            return self.obstacle_spheres
        thickening: Floats = np.array([*np.zeros(len(self.start)), self.clearance])
        return self.obstacle_spheres + thickening

    @cached_property
    def cells_code(self) -> str:
        """The code of the cells of a vehicle's configuration space, see `problems.sphere_path.cells`."""
        if self.hierarchy is not None:
            return self.hierarchy
        return making.made_or_kept(
            self.model_dump(mode="json", include={*making.SHAPING, "clearance"}), self._subdivide
        )

    @property
    def gaps(self) -> cells.Clearance:
        """The exact gaps between the vehicle and all obstacles, see `cells.Clearance`; each use prepares them anew."""
        assert self.vehicle is not None, "obstacles are there for a vehicle"
        return making.gaps_of(self.vehicle, self.mesh, self.obstacles)

    def _subdivide(self) -> str:
        """Return the code of the cells; a configuration that keeps too little distance is like one in collision."""
        gaps = self.gaps

        def spare(configurations: Floats) -> Floats:
            left: Floats = np.maximum(0.0, gaps(configurations) - self.clearance)
            return left

        return cells.subdivide(self.space, dimensions_of(self.mesh), self.accuracy, spare)

    def for_recipe(self, name: RecipeName, deme: int) -> Self:
        """Fill in also the spheres of a vehicle, so that a process that gets the problem need not make them again."""
        if self.vehicle is None or self.hierarchy is not None:
            return super().for_recipe(name, deme)
        known = self.model_dump(exclude_unset=True) | {"hierarchy": self.cells_code}
        return self.model_validate(known).for_recipe(name, deme)

    @property
    def solved_at(self) -> float:
        """The fitness at which a run ends: the length weight.

        A path that crosses nothing has less than that, any other at least 1. To search on for shorter paths, ask for
        less: ``--target 0`` with a stall or a deadline.
        """
        return self.length_weight

    @property
    def solved_when(self) -> str:
        """The condition of `solved_at` in words."""
        weighed = ", whatever the detour" if self.length_weight else ""
        return f"no sphere is crossed{weighed}"

    @cached_property
    def coding(self) -> BitString:
        """The coding: one integer of p bits for each of n components of m nodes."""
        from genetics.bit_string import BitString

        return BitString(self.nodes * len(self.start), self.bits, gray=self.code != "binary")

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the paper's recipe, or the tuned one with more mutation.

        In both, offspring of uniform crossover replace half of an island in each generation. The paper has no demes of
        one; there the tuned recipe keeps the best.
        """
        replacement: Replacement = "offspring" if name == "paper" else "elitist"
        flips = 1.0 if name == "paper" else _FLIPS
        rate = min(0.5, flips / self.coding.length)
        return Recipe("uniform", rate, replacement, pairing="better-half", renewal=0.5 if deme > 1 else None)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the numbers of obstacles crossed, plus the weighed detours: (n, genome_bytes) to (n,)."""
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code. All variants of the problem are compiled; none needs Python."""
        return self._compiled

    def paths(self, genomes: Genomes) -> tuple[Floats, NDArray[np.int64]]:
        """Return the paths that genomes code, (n, nodes + 2, axes), unwrapped, and their numbers of crossings, (n,)."""
        from problems.sphere_path import kernels

        places, crossed = kernels.follow(writable(genomes), self._compiled.table)
        return places / self.space.scale, crossed

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"path": [[..], ..], "crossed": 0, "length": L}``; in L a vehicle's angles count as arcs."""
        paths, crossed = self.paths(genome[None])
        length = length_of(paths[0] * self.space.scale)
        return {"path": paths[0].tolist(), "crossed": int(crossed[0]), "length": length}

    def describe(self, solution: Solution) -> str:
        """Return a text with the path's length, its crossings and its places."""
        rows = [", ".join(f"{place:9.4f}" for place in row) for row in solution["path"]]
        head = f"a path of length {solution['length']:.4g} that crosses {solution['crossed']} spheres:"
        return "\n".join([head, *(f"  {row}" for row in rows)])

    @cached_property
    def _compiled(self) -> Operator:
        """The fitness, with the table that all kernels read; `problems.sphere_path.kernels` names its parts."""
        from genetics.operators import Operator
        from problems.sphere_path import kernels
        from problems.sphere_path.hierarchy import hierarchy_of

        space = self.space
        # On a periodic axis the greatest place is the least one again, so the last code stops a step before it.
        codes = (1 << self.bits) - np.where(space.periodic, 0, 1)
        # Contact is free, so the kernels' spheres are smaller by it.
        obstacles = self.forbidden_spheres - [*np.zeros(len(self.start)), CONTACT]
        middle = space.low + space.span / 2.0
        obstacles[:, :-1] = middle + space.shorter(obstacles[:, :-1] - middle)  # the image within the bounds
        return Operator.of(
            kernels.evaluate,
            [self.bits, self.coding.gray, self.nodes],
            np.array([space.low, space.span / codes, space.periods, *self.ends]),
            [self.length_weight, length_of(self.straight), space.diagonal, obstacles[:, -1].max(initial=0.0)],
            *hierarchy_of(obstacles),
        )
