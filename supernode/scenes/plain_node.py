"""Plain values of YAML or JSON that know where they are, so that each error names the file and the field."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from problems.errors import BadInput, did_you_mean, shorten
from supernode.scenes.places import HERE, Floats, place

_AXES = "xyzw"


@dataclass(frozen=True, eq=False)
class Node:
    """A value of a file.

    Attributes:
        value: the plain value.
        file: the file's name.
        path: the field, such as ``world.collision_objects[2].id``; empty for the whole file.
    """

    value: Any
    file: str
    path: str = ""

    @property
    def where(self) -> str:
        """The file and the field, for messages."""
        return f"{self.file}: {self.path}" if self.path else self.file

    def error(self, expected: str, mend: str = "") -> BadInput:
        """Return the error about this value."""
        return BadInput(f"{self.where}: expected {expected}, found {shorten(self.value)}{mend}")

    def get(self, name: str) -> Node | None:
        """Return a field; None if it is not there or empty."""
        if not isinstance(self.value, Mapping):
            raise self.error(f"a table with {name!r}")
        value = self.value.get(name)
        return None if value is None else Node(value, self.file, f"{self.path}.{name}" if self.path else name)

    def need(self, name: str) -> Node:
        """Return a field that must be there."""
        found = self.get(name)
        if found is None:
            meant = did_you_mean(name, map(str, self.value))
            path = f"{self.path}.{name}" if self.path else name
            raise BadInput(f"{self.file}: {path}: expected this field, found nothing{meant}")
        return found

    def items(self) -> Iterator[tuple[str, Node]]:
        """Yield the names and fields of a table."""
        if not isinstance(self.value, Mapping):
            raise self.error("a table")
        for name, value in self.value.items():
            yield str(name), Node(value, self.file, f"{self.path}.{name}")

    def each(self, name: str) -> list[Node]:
        """Return the elements of a list; none if the field is not there."""
        found = self.get(name)
        return [] if found is None else list(found)

    def __iter__(self) -> Iterator[Node]:
        if not isinstance(self.value, list):
            raise self.error("a list")
        for number, value in enumerate(self.value):
            yield Node(value, self.file, f"{self.path}[{number}]")

    def number(self) -> float:
        """Return a finite number; also one such as 1e-05, which YAML 1.1 takes for a text."""
        try:
            number = math.nan if isinstance(self.value, bool) else float(self.value)
        except (TypeError, ValueError, OverflowError):
            number = math.nan
        if not math.isfinite(number):
            raise self.error("a number")
        return number

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str | int | float):  # YAML reads an id such as 7 as a number
            raise self.error("a text")
        text = str(self.value)
        if not text.isascii() and any("\ud800" <= each <= "\udfff" for each in text):
            raise self.error("a text that UTF-8 can hold")
        return text

    def numbers(self, count: int | None = None) -> list[float]:
        """Return numbers: of a list, or of a table with x, y, z and w."""
        if isinstance(self.value, Mapping) and count is not None:
            return [self.need(axis).number() for axis in _AXES[:count]]
        if not isinstance(self.value, list) or (count is not None and len(self.value) != count):
            raise self.error("a list of numbers" if count is None else f"{count} numbers")
        return [each.number() for each in self]

    def place(self, position: str = "position", quaternion: str = "orientation") -> Floats:
        """Return the place that this table holds; what it leaves out is 0, or no turn."""
        at, turn = self.get(position), self.get(quaternion)
        try:
            return place(
                [0.0, 0.0, 0.0] if at is None else at.numbers(3),
                [0.0, 0.0, 0.0, 1.0] if turn is None else turn.numbers(4),
            )
        except BadInput:
            raise
        except ValueError as error:
            raise BadInput(f"{self.where}: {error}") from None


def place_of(node: Node | None) -> Floats:
    """Return the place of a pose that may not be there."""
    return HERE if node is None else node.place()
