"""The tables ``[vehicle]`` and ``[mesh]`` of a problem file: what moves, and the solid that it moves around."""

from __future__ import annotations

import base64
import zlib
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError, field_validator, model_validator

from problems.errors import BadInput, shorten
from problems.plain_values import is_file
from problems.plane import Point, simple_polygon
from problems.tables import Table, quantity

Floats = NDArray[np.float64]

MOST_TRIANGLES = 100_000


class Mesh(Table):
    """A solid bounded by triangles; it has an inside if their surface is closed."""

    file: str | None = quantity("", "an STL or OBJ file, relative to the problem file", default=None)
    unit: float = quantity("m", "the length unit of the file, such as 0.001", default=1.0, gt=0, le=1e6)
    packed: str | None = quantity("", "the triangles, which replace the file when it is read", default=None)

    @model_validator(mode="after")
    def _named_or_packed(self) -> Self:
        if (self.file is None) == (self.packed is None):
            raise ValueError(f"expected file or packed triangles, found {'neither' if self.file is None else 'both'}")
        if self.packed is not None:
            _ = self.triangles
        return self

    @cached_property
    def triangles(self) -> Floats:
        """The triangles, shape (triangles, 3 corners, 3), m.

        Raises:
            ValueError: If only the name of a file is known, or the packed text holds no triangles.
        """
        if self.packed is None:
            raise ValueError(f"expected the triangles of a mesh, as `supernode.load` reads them, found {self.file!r}")
        return unpacked(self.packed)


class Vehicle(Table):
    """What moves, in its own frame: it turns about the origin."""

    radius: float | None = quantity("m", "radius of a disc or ball", default=None, gt=0, le=1e6)
    vertices: list[Point] | None = quantity(
        "m", "corners of a polygon in the plane, in order, instead of a radius", default=None
    )
    mesh: Mesh | None = quantity("", "a solid in space, instead of a radius", default=None)

    @field_validator("vertices")
    @classmethod
    def _simple(cls, vertices: list[Point] | None) -> list[Point] | None:
        return None if vertices is None else simple_polygon(vertices)

    @model_validator(mode="after")
    def _one_shape(self) -> Self:
        given = [name for name in ("radius", "vertices", "mesh") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"expected one of radius, vertices and mesh, found {' and '.join(given) or 'none'}")
        return self

    @cached_property
    def reach(self) -> float:
        """The distance of the vehicle's farthest point from its origin, m."""
        if self.radius is not None:
            return self.radius
        corners = np.array(self.vertices) if self.mesh is None else self.mesh.triangles.reshape(-1, 3)
        return float(np.linalg.norm(corners, axis=1).max())


def dimensions_of(*meshes: object) -> int:
    """Return how many dimensions a vehicle's world has: 3 if any of these meshes is given, else 2."""
    return 2 if all(mesh is None for mesh in meshes) else 3


def gathered(fields: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the fields of a problem file with the names of mesh files replaced by their triangles.

    Raises:
        BadInput: If a file cannot be read; the error names the field and the file.
    """
    mesh, vehicle = fields.get("mesh"), fields.get("vehicle")
    if isinstance(mesh, dict) and isinstance(mesh.get("file"), str):
        fields = fields | {"mesh": _filled(mesh, "mesh", folder)}
    if isinstance(vehicle, dict):
        own = vehicle.get("mesh")
        if isinstance(own, dict) and isinstance(own.get("file"), str):
            fields = fields | {"vehicle": vehicle | {"mesh": _filled(own, "vehicle.mesh", folder)}}
    return fields


def _filled(mesh: dict[str, Any], field: str, folder: Path) -> dict[str, Any]:
    named = {name: mesh[name] for name in ("file", "unit") if name in mesh}
    try:
        unit = Mesh.model_validate(named, strict=True).unit
    except ValidationError:
        return mesh  # validation of the whole problem raises the error
    triangles = _read(mesh["file"], field, folder) * unit
    return {name: value for name, value in mesh.items() if name not in named} | {"packed": packed(triangles)}


def _read(name: str, field: str, folder: Path) -> Floats:
    """Return the triangles of an STL or OBJ file, shape (triangles, 3, 3)."""
    try:
        import trimesh
    except ImportError as error:
        raise BadInput(f"{field}.file: reading meshes needs trimesh: pip install supernode[mesh]") from error
    path = folder / name
    if path.suffix.lower() not in (".stl", ".obj"):
        raise BadInput(f"{field}.file: expected a file that ends in .stl or .obj, found {shorten(name)}")
    if not is_file(path):
        raise BadInput(f"{field}.file: expected a file beside the problem file, found no {shorten(name)}")
    try:
        triangles = np.array(trimesh.load_mesh(path, process=False).triangles, np.float64)
    except Exception as error:  # trimesh's parsers raise errors of many types
        raise BadInput(f"{field}.file: expected a mesh in {name}, found {type(error).__name__}: {error}") from None
    if not 0 < len(triangles) <= MOST_TRIANGLES or not np.isfinite(triangles).all():
        raise BadInput(f"{field}.file: expected 1 to {MOST_TRIANGLES:,} triangles in {name}, found {len(triangles):,}")
    return triangles


def packed(triangles: Floats) -> str:
    """Return triangles, shape (n, 3, 3), as a text: corners in single precision, without repeats, and faces."""
    corners, faces = np.unique(triangles.reshape(-1, 3).astype("<f4"), axis=0, return_inverse=True)
    parts = np.array([len(corners)], "<i4"), corners, faces.astype("<i4")
    return base64.b64encode(zlib.compress(b"".join(part.tobytes() for part in parts), 9)).decode()


def unpacked(text: str) -> Floats:
    """Return the triangles of a text that `packed` made, in single precision.

    Raises:
        ValueError: If the text holds no triangles.
    """
    try:
        stream = zlib.decompressobj()
        # Bounded, since the text may come over the network: a count, corners of 12 bytes (three a triangle at most) and
        # faces of 12.
        data = stream.decompress(base64.b64decode(text, validate=True), 4 + 48 * MOST_TRIANGLES)
        if not stream.eof:
            raise ValueError
        count = int(np.frombuffer(data[:4], "<i4")[0])
        corners = np.frombuffer(data[4 : 4 + 12 * count], "<f4").reshape(count, 3)
        faces = np.frombuffer(data[4 + 12 * count :], "<i4").reshape(-1, 3)
        triangles: Floats = corners[faces].astype(np.float64)
    except (ValueError, IndexError, zlib.error) as error:
        raise ValueError("expected packed triangles, found another text") from error
    if not len(triangles) or not np.isfinite(triangles).all():
        raise ValueError("expected packed triangles, found none")
    return triangles
