"""Triangle meshes: read from files by trimesh, and written as texts, which travel inside the problem.

A mesh is a pair of arrays: vertices (V, 3) float64, m, and triangles (T, 3) int64, numbers of vertices. As a text it is
base64 of a compressed buffer: the numbers V and T as uint32, then vertices as float32 and triangles as int32, all of
them little-endian. Every reader of a problem sees the same rounded vertices.
"""

from __future__ import annotations

import base64
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]
Mesh = tuple[Floats, Integers]
Scale = tuple[float, float, float]

UNSCALED: Scale = (1.0, 1.0, 1.0)
SUFFIXES = (".stl", ".obj", ".dae")
_MOST_TRIANGLES = 2_000_000
_MOST_BYTES = 12 * 2 * 3 * _MOST_TRIANGLES  # of a decompressed text, which may come over the network


def encode_mesh(vertices: Floats, triangles: Integers) -> str:
    """Return a mesh as a text, with its vertices rounded to float32."""
    head = np.array([len(vertices), len(triangles)], "<u4").tobytes()
    body = np.ascontiguousarray(vertices, "<f4").tobytes() + np.ascontiguousarray(triangles, "<i4").tobytes()
    return base64.b64encode(zlib.compress(head + body, 6)).decode()


def decode_mesh(text: str) -> Mesh:
    """Return the mesh that `encode_mesh` wrote.

    Raises:
        ValueError: if the text is no mesh.
    """
    try:
        whole = zlib.decompressobj().decompress(base64.b64decode(text, validate=True), _MOST_BYTES)
    except (ValueError, zlib.error) as error:
        raise ValueError("expected a mesh as a text, found another text") from error
    count, faces = (int(each) for each in np.frombuffer(whole[:8], "<u4")) if len(whole) >= 8 else (0, 0)
    if len(whole) != 8 + 12 * (count + faces) or not faces:
        raise ValueError("expected a mesh as a text, found another text")
    vertices = np.frombuffer(whole, "<f4", 3 * count, 8).reshape(-1, 3).astype(np.float64)
    triangles = np.frombuffer(whole, "<i4", 3 * faces, 8 + 12 * count).reshape(-1, 3).astype(np.int64)
    if triangles.min() < 0 or triangles.max() >= count or not np.isfinite(vertices).all():
        raise ValueError("expected triangles of the mesh's own finite vertices, found others")
    return vertices, triangles


def scaled_name(name: str, scale: Scale) -> str:
    """Return the name under which a mesh is kept that a URDF uses with several scales; see `mesh_of`."""
    return f"{name} * {' '.join(f'{each:g}' for each in scale)}"


def mesh_text(meshes: dict[str, str], name: str, scale: Scale = UNSCALED) -> str:
    """Return the text of a mesh of the gathered ``robot.meshes``.

    A name stands for the mesh with the scale of its first use; only a URDF that uses one file with several scales (such
    as mirrored) has further entries, under `scaled_name`.

    Raises:
        BadInput: if the mesh is not there.
    """
    text = meshes.get(scaled_name(name, scale), meshes.get(name))
    if text is None:
        raise BadInput(f"robot.meshes: expected the mesh {name!r}, found {', '.join(sorted(meshes)) or 'none'}")
    return text


def mesh_of(meshes: dict[str, str], name: str, scale: Scale = UNSCALED) -> Mesh:
    """Return a mesh of the gathered ``robot.meshes``. Its scale is applied already, where the file is read.

    Raises:
        BadInput: if the mesh is not there, or is no mesh.
    """
    try:
        return decode_mesh(mesh_text(meshes, name, scale))
    except ValueError as error:
        if isinstance(error, BadInput):
            raise
        raise BadInput(f"robot.meshes: {name}: {error}") from None


def read_mesh(path: Path, scale: Scale, where: str) -> Mesh:
    """Return the mesh of a file; the parts of a scene are joined, each at its place.

    As everywhere in ROS, the up axis that a COLLADA file states is ignored.

    Args:
        path: an STL, OBJ or COLLADA (DAE) file.
        scale: factors of x, y and z.
        where: the field and the file that names the mesh, for messages.

    Raises:
        BadInput: if the file cannot be read or holds no triangles.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise BadInput(
            f"{where}: expected a mesh as STL, OBJ or DAE, found {path.name}; convert {path} to one of these"
        )
    vertices, triangles = _triangles_of(_loaded(path, where), path, where)
    if not len(triangles):
        raise BadInput(f"{where}: expected a mesh with triangles, found none in {path}")
    if len(triangles) > _MOST_TRIANGLES:
        raise BadInput(
            f"{where}: expected at most {_MOST_TRIANGLES:,} triangles, found {len(triangles):,} in {path}; simplify it"
        )
    if not np.isfinite(vertices).all():
        raise BadInput(f"{where}: expected finite coordinates, found others in {path}")
    return _without_empty(vertices * np.array(scale), triangles)


def _loaded(path: Path, where: str) -> Any:
    try:
        import trimesh
    except ImportError:
        raise BadInput(f"{where}: reading meshes needs trimesh; pip install 'supernode[robots]'") from None
    try:
        return trimesh.load_scene(str(path), process=False)
    except ImportError as error:  # trimesh reads COLLADA by pycollada
        raise BadInput(
            f"{where}: reading {path.name} needs a package: {error}; pip install 'supernode[robots]'"
        ) from None
    except Exception as error:  # trimesh has no errors of its own: a bad file ends in whatever its parser raises
        raise BadInput(f"{where}: expected a mesh that can be read, found {path}: {error}") from None


def _triangles_of(scene: Any, path: Path, where: str) -> Mesh:
    vertices, triangles, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
    for node in scene.graph.nodes_geometry:
        placement, name = scene.graph[node]
        part = scene.geometry[name]
        if not hasattr(part, "faces"):  # lines and points have no surface
            continue
        points, faces = np.asarray(part.vertices, np.float64), np.asarray(part.faces, np.int64)
        # Not every reader of trimesh checks what it reads.
        if points.shape[1:] != (3,) or faces.shape[1:] != (3,) or (faces.size and not _are_numbers(faces, points)):
            raise BadInput(f"{where}: expected triangles of points in space, found others in {path}")
        # Written out, as a product by BLAS may differ in its last bits from one processor to another.
        vertices.append(np.einsum("ij,nj->ni", placement[:3, :3], points) + placement[:3, 3])
        triangles.append(faces + count)
        count += len(points)
    return np.concatenate(vertices), np.concatenate(triangles)


def _are_numbers(faces: Integers, points: Floats) -> bool:
    """Return whether the faces are numbers of these points."""
    return bool(faces.min() >= 0 and faces.max() < len(points))


def _without_empty(vertices: Floats, triangles: Integers) -> Mesh:
    """Return the mesh with equal vertices joined, without unused ones, and without triangles of no extent."""
    vertices = vertices.astype(np.float32).astype(np.float64)
    unique, which = np.unique(vertices, axis=0, return_inverse=True)
    triangles = which.reshape(-1)[triangles]
    one, two, three = triangles.T
    # A triangle of two points is still a line that may be hit, but its neighbours share that line.
    kept = triangles[(one != two) & (two != three) & (one != three)]
    kept = kept if len(kept) else triangles
    used, numbers = np.unique(kept, return_inverse=True)
    return unique[used], numbers.reshape(-1, 3).astype(np.int64)
