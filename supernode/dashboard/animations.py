"""Translate animations of solutions into plain numbers from which a browser draws moving bodies.

The bodies of a problem are the same for all of its solutions, and they are most of the data. Therefore they are a
document of their own, which a browser fetches once and keeps; each better solution sends placements only. The browser
moves the vertices: one trace of plotly for all bodies of a role stays one trace, whichever step is shown.
"""

import gzip
import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from problems.animation import Animation
from supernode.dashboard.packing import COMPRESSION

_DIGITS = 4  # decimals of coordinates, m, and of rotations: 0.1 mm
_MARGIN = 0.3  # m around all that moves; obstacles farther away are cut off


@dataclass(frozen=True)
class Bodies:
    """The bodies of a problem, ready to be sent.

    Attributes:
        key: the digest of the content; placements name the bodies that they are for.
        packed: the JSON of the bodies, compressed by gzip.
    """

    key: str
    packed: bytes


def bodies_of(animation: Animation) -> Bodies:
    """Return the bodies of an animation as JSON, with vertices in m and lists flat: (V, 3) and (T, 3) row by row.

    Frames are numbered as in `placements_of`.
    """
    numbers = {frame: number for number, frame in enumerate(_frames(animation))}
    bodies = [
        {
            "name": body.name,
            "role": body.role,
            "frame": numbers[body.frame],
            "vertices": _rounded(body.vertices.reshape(-1)),
            "triangles": body.triangles.reshape(-1).tolist(),
        }
        for body in animation.bodies
    ]
    text = encoded({"unit": "m", "bodies": bodies})
    key = hashlib.sha256(text).hexdigest()[:16]
    return Bodies(key, gzip.compress(text, COMPRESSION))


def placements_of(animation: Animation, key: str) -> dict[str, Any]:
    """Return where the bodies are at each step, as plain JSON values.

    Args:
        animation: a sound animation.
        key: the key of its `Bodies`.

    Returns:
        a dict with ``"frames"``, shape (steps, F, 12), of only those frames that a body has; ghosts, lines, targets and
        curves as in `Animation`; and the ``"box"`` to show, shape (2, 3).
    """
    used = _frames(animation)
    return {
        "unit": "m",
        "bodies": key,
        "frames": _rounded(animation.frames[:, used]),
        "along": _rounded(animation.along),
        "along_name": animation.along_name,
        "ghosts": [{"name": ghost.name, "frames": _rounded(ghost.frames[used])} for ghost in animation.ghosts],
        "lines": [_rounded(line) for line in animation.lines],
        "targets": _rounded(animation.targets),
        "names": list(animation.names),
        "curves": _rounded(animation.curves),
        "curves_name": animation.curves_name,
        "box": _rounded(animation.box(_MARGIN)),
    }


def encoded(value: Any) -> bytes:
    """Return plain values as compact JSON."""
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode()


def _frames(animation: Animation) -> list[int]:
    return sorted({body.frame for body in animation.bodies})


def _rounded(values: Any) -> list[Any]:
    found: list[Any] = (np.round(values, _DIGITS) + 0.0).tolist()  # + 0.0: no negative zeros
    return found
