"""Change an input at random: its bytes, or one value in it."""

import copy
import math
from collections.abc import Sequence
from random import Random
from typing import Any

from fuzz.forms import Form

STRANGE: tuple[Any, ...] = (
    None,
    True,
    False,
    0,
    1,
    -1,
    255,
    1 << 31,
    (1 << 62) - 1,
    1 << 63,
    -(1 << 63),
    10**400,
    0.0,
    -0.0,
    0.5,
    5e-324,
    1e-9,
    1e9,
    1e308,
    -1e308,
    math.nan,
    math.inf,
    -math.inf,
    "",
    "0",
    "nan",
    "1e999",
    "../../etc/passwd",
    "\0",
    "é²\u2028",
    "\ud800",
    "x" * 300,
    b"",
    b"\xff" * 9,
    [],
    {},
    [[]],
    [0.0, 0.0],
    [0.0, 0.0, 0.0],
    [1, 1],
    {"": None},
)
_MOST_COPIES = 40


def mutated(seed: bytes, form: Form, others: Sequence[bytes], rng: Random) -> bytes:
    """Return ``seed`` with a few changes: in its values, if it can be read, or in its bytes.

    Args:
        seed: the input.
        form: its format.
        others: inputs from which values may be taken.
        rng: decides what changes.
    """
    if form.read is not None and form.write is not None and rng.random() < 0.8:
        try:
            value, other = form.read(seed), form.read(rng.choice(others))
            for _ in range(rng.choice((1, 1, 1, 2, 4))):
                value = with_a_change(value, other, rng)
            return form.write(value)
        except Exception:
            pass
    return _with_other_bytes(seed, rng)


def with_a_change(value: Any, other: Any, rng: Random) -> Any:
    """Return a copy of a plain value with one place changed; ``other`` is a value whose parts may be put in."""
    root = [copy.deepcopy(value)]
    holder, key = rng.choice(list(_places(root)))
    match rng.randrange(8):
        case 0 | 1:
            holder[key] = copy.deepcopy(rng.choice(STRANGE))
        case 2:
            its_holder, its_key = rng.choice(list(_places([other])))
            holder[key] = copy.deepcopy(its_holder[its_key])
        case 3:
            its_holder, its_key = rng.choice(list(_places(root)))
            holder[key] = copy.deepcopy(its_holder[its_key])
        case 4 if holder is not root:
            del holder[key]
        case 5 if isinstance(holder, list) and holder is not root:
            holder[key:key] = [copy.deepcopy(holder[key]) for _ in range(rng.choice((1, 2, _MOST_COPIES)))]
        case 6 if isinstance(holder, dict):
            holder[rng.choice(("", "unknown", f"{key}x", *map(str, holder)))] = holder.pop(key)
        case _:
            holder[key] = _near(holder[key], rng)
    return root[0]


def _places(holder: Any) -> Any:
    """Yield each place in nested lists and tables, as what holds a value and its key."""
    left = [holder]
    while left:
        inner = left.pop()
        for key, value in inner.items() if isinstance(inner, dict) else enumerate(inner):
            yield inner, key
            if isinstance(value, dict | list):
                left.append(value)


def _near(value: Any, rng: Random) -> Any:
    """Return another value of the same type; a list around one that has no neighbours."""
    match value:
        case bool():
            return not value
        case int():
            return value + rng.choice((-1, 1, -value, 1 << rng.randrange(40)))
        case float():
            return value * rng.choice((-1.0, 0.0, 0.5, 2.0, 1e-6, 1e6, 1e150)) + rng.choice((0.0, 1e-9, 0.1))
        case str():
            return _with_other_bytes(value.encode("utf-8", "replace"), rng).decode("utf-8", "replace")
        case bytes():
            return _with_other_bytes(value, rng)
    return [value]


def _with_other_bytes(data: bytes, rng: Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 2, 8))):
        start = rng.randrange(len(changed) + 1)
        end = min(len(changed), start + rng.choice((0, 1, 1, 2, 8)))
        match rng.randrange(4):
            case 0:
                del changed[start:end]
            case 1:
                changed[start:end] = rng.randbytes(end - start or 1)
            case 2:
                changed[start:end] = bytes(changed[start:end]) * 3
            case 3 if start < len(changed):
                changed[start] ^= 1 << rng.randrange(8)
    return bytes(changed)
