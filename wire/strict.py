"""Strict msgpack: lengths are checked before anything is unpacked, every limit is set, and types must match exactly.

Anything that reaches the router can send bytes, so a payload may be arbitrary. Reading one must neither raise anything
but `Rejected` nor take more memory than its length justifies.
"""

import json
import math
from typing import Any, TypeVar

import msgpack

MOST_BYTES = 16 << 20  # of any message
MOST_ELEMENTS = 1 << 16  # of any array: msgpack allocates them all as soon as it has read the array's length
Kind = TypeVar("Kind")


class Rejected(ValueError):  # noqa: N818
    """A message, or a part of one, is invalid.

    Attributes:
        reason: why. For messages between nodes it is one of a few fixed phrases, such as "wrong shape", by which
            refusals can be counted; for requests of clients it is a sentence.
    """

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def pack(value: Any) -> bytes:
    """Return ``value`` as msgpack."""
    packed: bytes = msgpack.packb(value)
    return packed


def unpack(
    payload: bytes, most_bytes: int = MOST_BYTES, most_elements: int = MOST_ELEMENTS, most_pairs: int = 0
) -> list[Any]:
    """Return the array that ``payload`` holds.

    Args:
        payload: msgpack, from anyone.
        most_bytes: the most bytes of the payload.
        most_elements: the most elements of any array in it.
        most_pairs: the most pairs of any map in it; 0: maps are refused.

    Raises:
        Rejected: "too long", "not msgpack" (also if one of the limits is exceeded) or "not an array".
    """
    if len(payload) > most_bytes:
        raise Rejected("too long")
    try:
        # No value can have more bytes or elements than the payload has bytes, whatever length it announces.
        value = msgpack.unpackb(
            payload,
            strict_map_key=True,
            max_str_len=len(payload),
            max_bin_len=len(payload),
            max_array_len=min(len(payload), most_elements),
            max_map_len=min(len(payload), most_pairs),
            max_ext_len=0,
        )
    except (ValueError, TypeError, RecursionError, MemoryError, msgpack.UnpackException) as error:
        raise Rejected("not msgpack") from error
    if type(value) is not list:
        raise Rejected("not an array")
    return value


def fields(value: Any, count: int) -> list[Any]:
    """Return ``value`` if it is an array of ``count`` elements.

    Raises:
        Rejected: "wrong shape".
    """
    if type(value) is not list or len(value) != count:
        raise Rejected("wrong shape")
    return value


def of(kind: type[Kind], value: Any) -> Kind:
    """Return ``value`` if its type is exactly ``kind``. A subclass does not count, so a bool is not an int.

    Raises:
        Rejected: "wrong type".
    """
    if type(value) is not kind:
        raise Rejected("wrong type")
    return value


def table(value: Any) -> dict[str, Any]:
    """Return the JSON object that the text ``value`` holds.

    Raises:
        Rejected: "wrong type" or "not JSON".
    """
    try:
        found = json.loads(of(str, value), parse_constant=_no_json)
    except Rejected:
        raise
    except (ValueError, RecursionError) as error:
        raise Rejected("not JSON") from error
    return of(dict, found)


def _no_json(word: str) -> None:
    """Refuse NaN and Infinity, which Python's reader accepts but JSON does not have."""
    raise ValueError(f"JSON has no {word}")


def count(value: Any, below: int = 1 << 62) -> int:
    """Return ``value`` if it is an int in [0, below).

    Raises:
        Rejected: "wrong type" or "out of bounds".
    """
    if type(value) is not int:
        raise Rejected("wrong type")
    if not 0 <= value < below:
        raise Rejected("out of bounds")
    return value


def fitness(value: Any) -> float:
    """Return ``value`` if it is a float other than NaN and -inf; +inf stands for infeasible.

    Raises:
        Rejected: "wrong type" or "not finite".
    """
    if type(value) is not float:
        raise Rejected("wrong type")
    if math.isnan(value) or value == -math.inf:
        raise Rejected("not finite")
    return value
