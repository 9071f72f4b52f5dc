"""Make the spheres of a vehicle among obstacles once, and keep them in the user's cache folder."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from problems.digests import digest
from problems.progress import telling
from problems.sphere_path import cells
from problems.sphere_path.vehicle import dimensions_of

if TYPE_CHECKING:
    from problems.sphere_path.model import SpherePath

# The fields that determine the spheres, besides the clearance.
SHAPING = ("vehicle", "mesh", "obstacles", "bounds", "periodic", "accuracy")
MOST_BYTES = 64 << 20  # of all files in the folder; the oldest are removed first
_DIGITS = 64  # of a SHA-256 digest in hexadecimal


def gaps_of(problem: SpherePath) -> cells.Clearance:
    """Return the exact gaps between a problem's vehicle and all obstacles, see `cells.Clearance`."""
    assert problem.vehicle is not None, "obstacles are there for a vehicle"
    # Imported here, since nodes get the spheres ready made and never measure a gap.
    if problem.mesh is None:
        from problems.sphere_path.floor import in_the_plane

        return in_the_plane(problem.vehicle, problem.obstacles)
    from problems.sphere_path.solid import in_space

    return in_space(problem.vehicle, problem.mesh.triangles)


def _spare_gaps_of(problem: SpherePath) -> cells.Clearance:
    """Return the gaps beyond the problem's clearance, 0 where nothing is left of them, see `cells.Clearance`."""
    gaps = gaps_of(problem)
    return lambda configurations: np.maximum(0.0, gaps(configurations) - problem.clearance)


def why_blocked(problem: SpherePath, place: list[float]) -> str:
    """Return, as the end of an error, whether the vehicle is too near to an obstacle, or only `accuracy` blocks it."""
    gap = float(gaps_of(problem)(np.array([place]))[0])
    if gap <= 0.0:
        return "in collision"
    if gap <= problem.clearance:
        return f"{gap:.3g} m from an obstacle, no more than the clearance {problem.clearance:g}"
    too_near = f"what the clearance {problem.clearance:g} forbids" if problem.clearance else "a collision"
    spare = gap - problem.clearance
    return (
        f"nearer than `accuracy` to {too_near}, though {spare:.3g} m away from {'it' if problem.clearance else 'one'}:"
        f" a finer accuracy may free it, such as {min(spare, problem.accuracy) / 2:.2g} instead of {problem.accuracy:g}"
    )


def made_or_kept(problem: SpherePath) -> str:
    """Return the code of the vehicle's cells from the cache, or make it, see `problems.sphere_path.cells`."""
    kept = folder() / digest([_source(), problem.model_dump(mode="json", include={*SHAPING, "clearance"})])
    code = _read(kept)
    if code is None:
        with telling("making the spheres of configurations in collision; they are kept for the next time"):
            gaps = _spare_gaps_of(problem)
            # Gaps less the clearance: a configuration that keeps too little distance is covered like one in collision.
            code = cells.subdivide(problem.space, dimensions_of(problem.mesh), problem.accuracy, gaps)
        with contextlib.suppress(OSError):  # the cache is optional: a full disk or a read-only home is no error
            _write(kept, code)
    return code


def folder() -> Path:
    """Return the folder of the cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "supernode" / "spheres"


@cache
def _source() -> str:
    """Return a digest of this package's source, so that spheres made by another version are never used."""
    files = sorted(Path(__file__).parent.glob("*.py"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _read(path: Path) -> str | None:
    """Return the code in a file of the cache; None if there is none, or the file is damaged."""
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError):
        return None
    stated, code = text[:_DIGITS], text[_DIGITS:]
    return code if hashlib.sha256(code.encode()).hexdigest() == stated else None


def _write(path: Path, code: str) -> None:
    """Write a code to the cache, and remove the oldest files beyond `MOST_BYTES`.

    Raises:
        OSError: If the folder cannot be written.
    """
    # Other processes may read or write the same file now. A draft of its own name and a rename show each of them a
    # whole file or none.
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = path.with_name(f"{path.name}.{secrets.token_hex(4)}")
    draft.write_text(hashlib.sha256(code.encode()).hexdigest() + code, encoding="ascii")
    draft.replace(path)
    files = sorted(((file.stat().st_mtime_ns, file) for file in path.parent.iterdir()), reverse=True)
    total = 0
    # Newest first, so that the oldest files are the ones beyond the limit.
    for _, file in files:
        total += file.stat().st_size
        if total > MOST_BYTES:
            file.unlink(missing_ok=True)
