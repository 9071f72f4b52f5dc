"""The torus: the shape of the SuperNode of 1992 (Ahuactzin et al. 1992, §6, figure 7)."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


@dataclass(frozen=True)
class Torus:
    """``rows`` × ``columns`` cells, each with four slots in the order north, east, south, west.

    On small shapes slots repeat a cell, or name the cell itself: on 1 × 1 all four slots are cell 0.

    Raises:
        ValueError: if there is not at least one row and one column.
    """

    rows: int
    columns: int

    def __post_init__(self) -> None:
        if self.rows < 1 or self.columns < 1:
            raise ValueError(f"expected a torus of at least 1 row and 1 column, found {self.rows} x {self.columns}")

    @property
    def spec(self) -> str:
        """Such as ``"torus 4x4"``."""
        return f"torus {self.rows}x{self.columns}"

    @property
    def cells(self) -> int:
        """Rows × columns."""
        return self.rows * self.columns

    @property
    def diameter(self) -> int:
        """Half way round in both directions."""
        return self.rows // 2 + self.columns // 2

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """The cells to the north, east, south and west of ``cell``."""
        row, column = self.place(cell)
        return (
            self._cell(row - 1, column),
            self._cell(row, column + 1),
            self._cell(row + 1, column),
            self._cell(row, column - 1),
        )

    def table(self) -> "NDArray[np.int64]":
        """The neighbours of all cells, shape (cells, 4)."""
        import numpy as np

        grid = np.arange(self.cells).reshape(self.rows, self.columns)
        sides = ((1, 0), (-1, 1), (-1, 0), (1, 1))  # by how much to shift along which axis: north, east, south, west
        return np.stack([np.roll(grid, shift, axis).ravel() for shift, axis in sides], axis=1)

    def place(self, cell: int) -> tuple[int, int]:
        """(row, column) of ``cell``."""
        if not 0 <= cell < self.cells:
            raise ValueError(f"expected a cell of {self.spec}, 0 to {self.cells - 1}, found {cell}")
        return divmod(cell, self.columns)

    def _cell(self, row: int, column: int) -> int:
        return (row % self.rows) * self.columns + column % self.columns
