"""What every topology answers, whatever its shape."""

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

ROOT = 0
"""The root cell, at which the spy sits."""


class Topology(Protocol):
    """A graph of cells, numbered from 0 (the root) in a fixed order."""

    @property
    def spec(self) -> str:
        """The text that `topologies.parse` turns into this topology, such as ``"torus 4x4"``."""
        ...

    @property
    def cells(self) -> int:
        """The number of cells."""
        ...

    @property
    def diameter(self) -> int:
        """The greatest distance, in links, between two cells."""
        ...

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """The neighbours of ``cell``, one for each of its slots; a small graph may repeat a cell."""
        ...

    def table(self) -> "NDArray[np.int64]":
        """The neighbours of all cells at once, shape (cells, slots): row after row what `neighbours` says."""
        ...

    def place(self, cell: int) -> tuple[int, ...]:
        """The coordinates by which people name ``cell``: (row, column) on a torus."""
        ...
