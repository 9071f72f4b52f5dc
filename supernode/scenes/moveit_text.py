"""Read the geometry of a planning scene as MoveIt writes it as text: ``.scene`` files, of the old and the new form.

The first line is the scene's name. An object begins with a line ``* id``. In the new form its place follows (position,
quaternion x, y, z, w). Then come the number of shapes and, for each, its kind, its sizes, its place and its colour; in
the new form then the number of subframes and, for each, a name and a place. A line ``.`` ends the scene. Which form it
is shows the line below the first id: three numbers, or one.
"""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Callable
from typing import TypeVar

from problems.errors import BadInput, shorten
from supernode.scenes import shapes
from supernode.scenes.places import HERE, Floats, place
from supernode.scenes.scene import WORLD, Mesh, Scene, Solid

Number = TypeVar("Number", int, float)

_SIZES = {"sphere": 1, "box": 3, "cylinder": 2, "cone": 2}
_MOST = 5_000_000  # vertices, triangles, shapes


def read_scene(text: str, where: str) -> Scene:
    """Return the scene of a text.

    Args:
        text: the file's text.
        where: the file, for messages.

    Raises:
        BadInput: if it is no such text; the message names the line and the object.
    """
    reader = _Reader(text, where)
    reader.line()  # the name
    is_new = _is_new(text)
    solids: list[Solid] = []
    while True:
        marker = reader.word("'* id' of an object, or '.' at the end")
        if marker == ".":
            return Scene(solids=solids)
        if marker != "*":
            raise reader.error("'* id' of an object, or '.' at the end", marker)
        solids += _object(reader, reader.line().strip(), is_new)


def _is_new(text: str) -> bool:
    found = re.search(r"^[ \t]*\*.*\n(.*)$", text, re.MULTILINE)
    return found is not None and len(found[1].split()) > 1


def _object(reader: _Reader, name: str, is_new: bool) -> list[Solid]:
    reader.about = f"object {name!r}"
    origin = reader.place() if is_new else HERE
    solids = []
    for number in range(reader.count("the number of shapes")):
        solids.append(_shape(reader, name, origin, number))
        reader.numbers(4, float, "a colour")
    if is_new:
        for _ in range(reader.count("the number of subframes")):
            reader.word("the name of a subframe")
            reader.place()
    reader.about = ""
    return solids


def _shape(reader: _Reader, name: str, origin: Floats, number: int) -> Solid:
    where = reader.where
    kind = reader.word("a shape")
    if kind == "mesh":
        triangles = _mesh(reader)
        fields, mesh = {"shape": "mesh"}, triangles
    elif kind in _SIZES:
        found = shapes.primitive(kind, reader.numbers(_SIZES[kind], float, f"sizes of a {kind}"), where)
        fields, mesh = found  # type: ignore[assignment]
    else:
        raise reader.error("box, sphere, cylinder, cone or mesh", kind, "; replace or remove it")
    pose = origin @ reader.place()
    return Solid(name if number == 0 else f"{name}.{number + 1}", fields, WORLD, pose, where, mesh)


def _mesh(reader: _Reader) -> Mesh:
    vertices, triangles = reader.count("the number of vertices"), reader.count("the number of triangles")
    points = reader.numbers(3 * vertices, float, "a vertex")
    corners = reader.numbers(3 * triangles, int, "a triangle")
    rows = [corners[first : first + 3] for first in range(0, len(corners), 3)]
    return shapes.mesh([points[first : first + 3] for first in range(0, len(points), 3)], rows, reader.where)


class _Reader:
    """Reads lines and words, and knows where it is.

    Attributes:
        about: the object that is read, for messages.
    """

    def __init__(self, text: str, file: str) -> None:
        self.about = ""
        self._text, self._file, self._at = text, file, 0

    @property
    def where(self) -> str:
        """The file, the line and the object."""
        line = f"{self._file}: line {self._text.count(chr(10), 0, self._at) + 1}"
        return f"{line}: {self.about}" if self.about else line

    def error(self, expected: str, found: str, mend: str = "") -> BadInput:
        """Return the error about the last word."""
        return BadInput(f"{self.where}: expected {expected}, found {shorten(found)}{mend}")

    def line(self) -> str:
        """Return the rest of this line."""
        end = self._text.find("\n", self._at)
        end = len(self._text) if end < 0 else end
        line, self._at = self._text[self._at : end], min(end + 1, len(self._text))
        return line

    def word(self, expected: str) -> str:
        """Return the next word, on this line or a later one."""
        found = _WORD.match(self._text, self._at)
        if found is None:
            raise BadInput(f"{self.where}: expected {expected}, found the end of the file; the file is cut off")
        self._at = found.end()
        return found[1]

    def numbers(self, count: int, kind: Callable[[str], Number], expected: str) -> list[Number]:
        """Return the next numbers."""
        values = []
        for _ in range(count):
            word = self.word(expected)
            with contextlib.suppress(ValueError):
                value = kind(word)
                if abs(value) < math.inf:  # neither is NaN
                    values.append(value)
                    continue
            raise self.error(f"a number ({expected})", word)
        return values

    def count(self, expected: str) -> int:
        """Return the next number, which says how many follow."""
        (number,) = self.numbers(1, int, expected)
        if not 0 <= number <= _MOST:
            raise self.error(f"{expected} from 0 to {_MOST:,}", str(number))
        return number

    def place(self) -> Floats:
        """Return the next place: x, y, z and a quaternion."""
        x, y, z, *quaternion = self.numbers(7, float, "a place: x y z, and a quaternion x y z w")
        try:
            return place((x, y, z), quaternion)
        except ValueError as error:
            raise BadInput(f"{self.where}: {error}") from None


_WORD = re.compile(r"\s*(\S+)")
