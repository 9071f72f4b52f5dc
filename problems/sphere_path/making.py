"""Make the spheres of a vehicle among obstacles once, and keep them in the user's cache folder."""

import contextlib
import hashlib
import os
import secrets
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from problems.digests import digest
from problems.plane import Obstacle
from problems.progress import reporting_if_slow
from problems.sphere_path import cells
from problems.sphere_path.vehicle import Mesh, Vehicle

# The fields that determine the spheres, besides the clearance.
SHAPING = ("vehicle", "mesh", "obstacles", "bounds", "periodic", "accuracy")
MOST_BYTES = 64 << 20  # of all files in the folder; the oldest are removed first
_DIGITS = 64  # of a SHA-256 digest in hexadecimal


def gaps_of(vehicle: Vehicle, mesh: Mesh | None, obstacles: list[Obstacle]) -> cells.Clearance:
    """Return the exact gaps between a vehicle and all obstacles, see `cells.Clearance`."""
    # Imported here, since nodes get the spheres ready made and never measure a gap.
    if mesh is None:
        from problems.sphere_path.floor import in_the_plane

        return in_the_plane(vehicle, obstacles)
    from problems.sphere_path.solid import in_space

    return in_space(vehicle, mesh.triangles)


def made_or_kept(shaping: Mapping[str, Any], make: Callable[[], str]) -> str:
    """Return the code of the vehicle's cells from the cache, or make it, see `problems.sphere_path.cells`.

    Args:
        shaping: the fields that determine the spheres, as plain values.
        make: makes the code.
    """
    kept = folder() / digest([_source(), shaping])
    code = _read(kept)
    if code is None:
        with reporting_if_slow("making the spheres of configurations in collision; they are kept for the next time"):
            code = make()
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
