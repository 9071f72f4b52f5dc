"""Cells in rows and columns: the torus, with and without diagonal neighbours, and the grid, which has edges.

The torus is the shape of the SuperNode of 1992 (Ahuactzin et al. 1992, §6, figure 7).
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

_NORTH, _EAST, _SOUTH, _WEST = (-1, 0), (0, 1), (1, 0), (0, -1)
_DIAGONALS = (-1, 1), (1, 1), (1, -1), (-1, -1)


@dataclass(frozen=True)
class _Rectangle(ABC):
    """``rows`` × ``columns`` cells, numbered row by row.

    Raises:
        ValueError: if there is not at least one row and one column.
    """

    rows: int
    columns: int

    name: ClassVar[str]
    sides: ClassVar[tuple[tuple[int, int], ...]] = (_NORTH, _EAST, _SOUTH, _WEST)
    """Where the slots' neighbours are: rows down and columns to the right, in the order of the slots."""

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise ValueError(f"expected at least 1 row and 1 column, found {self.rows} x {self.columns}")

    @property
    def spec(self) -> str:
        """Such as ``"torus 4x4"``."""
        return f"{self.name} {self.rows}x{self.columns}"

    @property
    def cells(self) -> int:
        """Rows × columns."""
        return self.rows * self.columns

    @abstractmethod
    def beside(self, cell: int, down: int, right: int) -> int:
        """The cell so many rows down and columns to the right of ``cell``."""

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """The cells beside ``cell``, in the order of the slots."""
        return tuple(self.beside(cell, down, right) for down, right in self.sides)

    @abstractmethod
    def table(self) -> "NDArray[np.int64]":
        """The neighbours of all cells, shape (cells, slots)."""

    def place(self, cell: int) -> tuple[int, int]:
        """(row, column) of ``cell``."""
        if not 0 <= cell < self.cells:
            raise ValueError(f"expected a cell of {self.spec}, 0 to {self.cells - 1}, found {cell}")
        return divmod(cell, self.columns)


class Torus(_Rectangle):
    """Four slots in the order north, east, south, west; beyond an edge the opposite one goes on.

    On small shapes slots repeat a cell, or name the cell itself: on 1 × 1 all four slots are cell 0.
    """

    name = "torus"

    @property
    def diameter(self) -> int:
        """Half way round in both directions."""
        return self.rows // 2 + self.columns // 2

    def beside(self, cell: int, down: int, right: int) -> int:
        """Round the torus."""
        row, column = self.place(cell)
        return (row + down) % self.rows * self.columns + (column + right) % self.columns

    def table(self) -> "NDArray[np.int64]":
        """The neighbours of all cells, shape (cells, slots)."""
        import numpy as np

        grid = np.arange(self.cells).reshape(self.rows, self.columns)
        return np.stack([np.roll(grid, (-down, -right), (0, 1)).ravel() for down, right in self.sides], axis=1)


class Moore(Torus):
    """A torus with eight slots: after the four of the torus north-east, south-east, south-west, north-west."""

    name = "moore"
    sides = (*_Rectangle.sides, *_DIAGONALS)

    @property
    def diameter(self) -> int:
        """Half way round in the longer direction: a diagonal link goes in both."""
        return max(self.rows // 2, self.columns // 2)


class Grid(_Rectangle):
    """The torus with edges: a slot that would lead over one names the cell itself."""

    name = "grid"

    @property
    def diameter(self) -> int:
        """From corner to corner."""
        return self.rows - 1 + self.columns - 1

    def beside(self, cell: int, down: int, right: int) -> int:
        """Not over the edge."""
        row, column = self.place(cell)
        inside = 0 <= row + down < self.rows and 0 <= column + right < self.columns
        return cell + down * self.columns + right if inside else cell

    def table(self) -> "NDArray[np.int64]":
        """The neighbours of all cells, shape (cells, 4)."""
        import numpy as np

        cells = np.arange(self.cells)
        rows, columns = np.divmod(cells, self.columns)
        sides = []
        for down, right in self.sides:
            inside = (rows + down >= 0) & (rows + down < self.rows)
            inside &= (columns + right >= 0) & (columns + right < self.columns)
            sides.append(np.where(inside, cells + down * self.columns + right, cells))
        return np.stack(sides, axis=1)


def torus_of(nodes: int) -> str:
    """The most square torus of so many nodes: 128 is ``"torus 8x16"``."""
    rows = next(rows for rows in range(math.isqrt(nodes), 0, -1) if nodes % rows == 0)
    return f"torus {rows}x{nodes // rows}"
