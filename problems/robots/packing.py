"""Pack arrays and names into one text and back, exactly: how compact models travel to the nodes.

The text is base64 of a compressed buffer. Arrays are stored as the smallest type that holds their values exactly, and
repeated corners of triangles once.
"""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Arrays = dict[str, Any]  # arrays of float64 or int64, or tuples of names
_MOST_BYTES = 1 << 28  # of an unpacked text: it may come over the network
_TYPES = ("int8", "int16", "int32", "int64", "float32", "float64")
_LITTLE: Literal["<"] = "<"  # the byte order of the text


def pack(parts: Mapping[str, Any]) -> str:
    """Return arrays (float64 or int64, any shape) and tuples of names as one text."""
    header, buffers = [], []
    for name, part in parts.items():
        if isinstance(part, tuple):
            header.append([name, list(part)])
            continue
        for kind, array in _stored(np.ascontiguousarray(part)):
            header.append([name + kind, array.dtype.name, list(array.shape)])
            buffers.append(array.astype(array.dtype.newbyteorder(_LITTLE)).tobytes())
    head = json.dumps(header, separators=(",", ":")).encode()
    whole = len(head).to_bytes(4, "little") + head + b"".join(buffers)
    return base64.b64encode(zlib.compress(whole, 6)).decode()


def unpack(text: str) -> Arrays:
    """Return what `pack` packed, as arrays that may be written to.

    Raises:
        ValueError: if the text is no such text, or would unfold to more than 256 MiB.
    """
    try:
        reader = zlib.decompressobj()
        whole = reader.decompress(base64.b64decode(text, validate=True), _MOST_BYTES)
        if not reader.eof:
            raise ValueError("too long, or cut off")
        size = int.from_bytes(whole[:4], "little")
        return _read(json.loads(whole[4 : 4 + size]), whole, 4 + size)
    except (LookupError, AttributeError, ValueError, TypeError, OverflowError, RecursionError, zlib.error) as error:
        raise ValueError(f"expected a packed model, found another text ({error})") from error


def _read(header: list[Any], whole: bytes, place: int) -> Arrays:
    parts: Arrays = {}
    left = _MOST_BYTES
    for name, *what in header:
        if len(what) == 1:
            parts[name] = tuple(str(each) for each in what[0])
            continue
        kind, shape = what
        if kind not in _TYPES:
            raise ValueError(f"unknown type {kind!r}")
        stored = np.dtype(kind).newbyteorder(_LITTLE)
        count = math.prod(shape)
        left -= 8 * count
        if count < 0 or left < 0:
            raise ValueError("too long")
        array = np.frombuffer(whole, stored, count, place).reshape(shape)
        place += count * stored.itemsize
        parts[name] = array.astype(np.float64 if kind.startswith("float") else np.int64)
    for name in [each for each in parts if each.endswith("/corners")]:
        own = name.removesuffix("/corners")
        which, corners = parts.pop(f"{own}/which"), parts.pop(name)
        left -= 24 * which.size
        if left < 0:
            raise ValueError("too long")
        parts[own] = corners[which].reshape(len(which), 9)
    return parts


def _stored(array: NDArray[Any]) -> list[tuple[str, NDArray[Any]]]:
    """Return the arrays to store for one, each with what to add to its name."""
    if array.dtype == np.float64 and array.ndim == 2 and array.shape[1] == 9 and len(array):
        # Unique by bits, so that -0.0 and 0.0 stay what they are.
        bits = array.reshape(-1, 3).view(np.uint64)
        _, first, which = np.unique(bits, axis=0, return_index=True, return_inverse=True)
        corners = array.reshape(-1, 3)[first]
        return [("/which", _smallest(which.reshape(-1, 3).astype(np.int64))), ("/corners", _smallest(corners))]
    return [("", _smallest(array))]


def _smallest(array: NDArray[Any]) -> NDArray[Any]:
    """Return the array as the smallest type that holds all of its values exactly."""
    if array.dtype == np.float64:
        with np.errstate(over="ignore"):
            single = array.astype(np.float32)
        return single if np.array_equal(single.astype(np.float64), array, equal_nan=True) else array
    for name in _TYPES[:4]:
        bounds = np.iinfo(name)
        if not array.size or (bounds.min <= array.min() and array.max() <= bounds.max):
            return array.astype(name)
    return array
