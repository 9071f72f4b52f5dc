"""Topologies of cells in rows and columns: the torus, with or without diagonal neighbours, and the grid with borders.

The torus is the topology of the SuperNode of 1992 (Ahuactzin et al. 1992, §6, figure 7).
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
    """The offset of each slot's neighbour, (rows down, columns to the right), in the order of the slots."""
    wraps: ClassVar[bool] = False
    """Whether links lead around the edges, so that a drawing may cross them."""

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise ValueError(f"expected at least 1 row and 1 column, found {self.rows} x {self.columns}")

    @property
    def spec(self) -> str:
        """The text that names this topology, such as ``"torus 4x4"``."""
        return f"{self.name} {self.rows}x{self.columns}"

    @property
    def cells(self) -> int:
        """The number of cells: rows × columns."""
        return self.rows * self.columns

    @abstractmethod
    def beside(self, cell: int, down: int, right: int) -> int:
        """Return the cell ``down`` rows below and ``right`` columns to the right of ``cell``."""

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """Return the neighbours of ``cell``, in the order of the slots."""
        return tuple(self.beside(cell, down, right) for down, right in self.sides)

    @abstractmethod
    def table(self) -> "NDArray[np.int64]":
        """Return the neighbours of all cells, shape (cells, slots)."""

    def place(self, cell: int) -> tuple[int, int]:
        """Return (row, column) of ``cell``.

        Raises:
            ValueError: if there is no such cell.
        """
        if not 0 <= cell < self.cells:
            raise ValueError(f"expected a cell of {self.spec}, 0 to {self.cells - 1}, found {cell}")
        return divmod(cell, self.columns)


class Torus(_Rectangle):
    """A torus with four slots, in the order north, east, south, west. Beyond a border follows the opposite one.

    On small tori several slots name the same cell, or the cell itself: on 1 × 1 all four slots are cell 0.
    """

    name = "torus"
    wraps = True

    @property
    def diameter(self) -> int:
        """The greatest distance between two cells: half way round in both directions."""
        return self.rows // 2 + self.columns // 2

    def beside(self, cell: int, down: int, right: int) -> int:
        """Return the cell at an offset from ``cell``, wrapping around at the borders."""
        row, column = self.place(cell)
        return (row + down) % self.rows * self.columns + (column + right) % self.columns

    def table(self) -> "NDArray[np.int64]":
        """Return the neighbours of all cells, shape (cells, slots)."""
        import numpy as np  # not at the top: to name a topology takes no numpy, which is slow to import

        grid = np.arange(self.cells).reshape(self.rows, self.columns)
        return np.stack([np.roll(grid, (-down, -right), (0, 1)).ravel() for down, right in self.sides], axis=1)


class Moore(Torus):
    """A torus with eight slots: the four of `Torus`, then north-east, south-east, south-west, north-west."""

    name = "moore"
    sides = (*_Rectangle.sides, *_DIAGONALS)

    @property
    def diameter(self) -> int:
        """The greatest distance between two cells: half way round in the longer direction; diagonals go in both."""
        return max(self.rows // 2, self.columns // 2)


class Grid(_Rectangle):
    """A rectangle with borders and four slots. A slot that would lead over a border names the cell itself."""

    name = "grid"

    @property
    def diameter(self) -> int:
        """The greatest distance between two cells: from corner to opposite corner."""
        return self.rows - 1 + self.columns - 1

    def beside(self, cell: int, down: int, right: int) -> int:
        """Return the cell at an offset from ``cell``, or ``cell`` itself if the offset leads over a border."""
        row, column = self.place(cell)
        inside = 0 <= row + down < self.rows and 0 <= column + right < self.columns
        return cell + down * self.columns + right if inside else cell

    def table(self) -> "NDArray[np.int64]":
        """Return the neighbours of all cells, shape (cells, 4)."""
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
    """Return the spec of the most nearly square torus of ``nodes`` cells: for 128 it is ``"torus 8x16"``."""
    rows = next(rows for rows in range(math.isqrt(nodes), 0, -1) if nodes % rows == 0)
    return f"torus {rows}x{nodes // rows}"
