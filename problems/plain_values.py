"""Plain values of foreign texts: how deep they may be nested, and whether a name in them is that of a file."""

from pathlib import Path
from typing import Any

MOST_NESTED = 64
"""Tables and arrays within each other: far more than any problem has, and few enough for all that recurses."""


def refuse_nested(value: Any) -> None:
    """Refuse values that are nested too deeply.

    A text that a reader just manages would end in a RecursionError wherever it is written or compared later.

    Raises:
        ValueError: if tables and arrays are within more than `MOST_NESTED` others.
    """
    level = [value]
    for _ in range(MOST_NESTED + 1):
        inner = [each for each in level if isinstance(each, dict | list)]
        if not inner:
            return
        level = [held for each in inner for held in (each.values() if isinstance(each, dict) else each)]
    raise ValueError(f"tables or arrays within more than {MOST_NESTED} others")


def is_file(path: Path) -> bool:
    """Return whether there is such a file; no error if no file can have that name, such as one that is too long."""
    try:
        return path.is_file()
    except OSError:
        return False
