"""The interface of all topologies."""

from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

ROOT = 0
"""The root cell, whose messages the spy receives."""


class Topology(Protocol):
    """A graph of cells, numbered from 0 (the root) in a fixed order.

    All cells have the same number of slots (neighbour positions), so that the neighbours of all cells are one array. A
    slot that would be left over names the cell itself. Links are mutual: if a slot of cell a names b, one of b names a.

    What else must hold:

    - The graph is connected, and no cell has more than `topologies.graphs.MOST_DEGREE` neighbours.
    - `diameter` is exact. The common stop of a lockstep run depends on it: with one too small, cells would stop after
      different generations.
    - Topologies are compared by value: two with the same `spec` are equal.

    A topology that is drawn as a rectangle also has ``rows``, ``columns`` and ``wraps`` (`topologies.grids`). Any other
    one is drawn like the most square torus, without links around the edges.
    """

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
        """The greatest distance, in links, between two cells. It bounds how long news takes to reach all cells."""
        ...

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """Return the neighbours of ``cell``, one for each of its slots. A small graph may repeat a cell.

        Raises:
            ValueError: if there is no such cell.
        """
        ...

    def table(self) -> "NDArray[np.int64]":
        """Return the neighbours of all cells at once, shape (cells, slots): row c has the neighbours of cell c."""
        ...

    def place(self, cell: int) -> tuple[int, ...]:
        """Return the coordinates by which people name ``cell``: (row, column) on a torus.

        Raises:
            ValueError: if there is no such cell.
        """
        ...


def first_neighbour(topology: Topology, cell: int) -> int | None:
    """Return the first other cell among the neighbours of a cell; None if it is its only neighbour."""
    return next((other for other in topology.neighbours(cell) if other != cell), None)
