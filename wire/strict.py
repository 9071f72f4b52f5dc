"""Strict msgpack: the length is checked before anything is unpacked, every limit is set, and types are exact."""

import json
import math
from typing import Any, TypeVar

import msgpack

MOST_BYTES = 16 << 20  # of any message
MOST_ELEMENTS = 1 << 16  # of any array: room for them is made as soon as its length is read
Kind = TypeVar("Kind")


class Rejected(ValueError):  # noqa: N818
    """A message that is not what it should be; ``reason`` is one of a few short words, to be counted by."""

    def __init__(self, reason: str) -> None:
        super().__init__(reason)
        self.reason = reason


def pack(value: Any) -> bytes:
    """``value`` as msgpack."""
    packed: bytes = msgpack.packb(value)
    return packed


def unpack(
    payload: bytes, most_bytes: int = MOST_BYTES, most_elements: int = MOST_ELEMENTS, most_pairs: int = 0
) -> list[Any]:
    """The array in ``payload``, of which no array has more than ``most_elements``, and no map more than ``most_pairs``.

    Raises:
        Rejected: "too long", "not msgpack" or "not an array".
    """
    if len(payload) > most_bytes:
        raise Rejected("too long")
    try:
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
    """``value`` if it is an array of that many elements."""
    if type(value) is not list or len(value) != count:
        raise Rejected("wrong shape")
    return value


def of(kind: type[Kind], value: Any) -> Kind:
    """``value`` if it is exactly of that type (so that a bool is no int)."""
    if type(value) is not kind:
        raise Rejected("wrong type")
    return value


def table(value: Any) -> dict[str, Any]:
    """The JSON object in ``value``, a text."""
    try:
        found = json.loads(of(str, value), parse_constant=_no_json)
    except Rejected:
        raise
    except (ValueError, RecursionError) as error:
        raise Rejected("not JSON") from error
    return of(dict, found)


def _no_json(word: str) -> None:
    raise ValueError(f"JSON has no {word}")


def count(value: Any, below: int = 1 << 62) -> int:
    """``value`` if it is an int in [0, below)."""
    if type(value) is not int:
        raise Rejected("wrong type")
    if not 0 <= value < below:
        raise Rejected("out of bounds")
    return value


def fitness(value: Any) -> float:
    """``value`` if it is a float other than NaN and -inf."""
    if type(value) is not float:
        raise Rejected("wrong type")
    if math.isnan(value) or value == -math.inf:
        raise Rejected("not finite")
    return value
