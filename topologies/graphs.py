"""Graphs that are no rectangles: the ring, the hypercube, the complete graph, and random ones built by networkx.

Every cell has as many slots as the one with the most neighbours; slots that are left over name the cell itself.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MOST_DEGREE = 255
"""A node has a link to each neighbour."""
MOST_RANDOM = 1 << 14
"""Cells of a random graph, whose diameter must be searched for."""
MOST_SEED = (1 << 32) - 1
_TRIES = 100


@dataclass(frozen=True)
class _Graph(ABC):
    """Cells that are numbered, and have no other place."""

    @property
    @abstractmethod
    def spec(self) -> str:
        """The text that names this graph."""

    @property
    @abstractmethod
    def cells(self) -> int:
        """The number of cells."""

    @abstractmethod
    def neighbours(self, cell: int) -> tuple[int, ...]:
        """The neighbours of ``cell``, one for each of its slots."""

    def table(self) -> "NDArray[np.int64]":
        """The neighbours of all cells, shape (cells, slots)."""
        import numpy as np

        return np.array([self.neighbours(cell) for cell in range(self.cells)], np.int64)

    def place(self, cell: int) -> tuple[int]:
        """The number of ``cell``."""
        if not 0 <= cell < self.cells:
            raise ValueError(f"expected a cell of {self.spec}, 0 to {self.cells - 1}, found {cell}")
        return (cell,)


@dataclass(frozen=True)
class Ring(_Graph):
    """``size`` cells, each with the one before it and the one after it.

    Raises:
        ValueError: if there is no cell.
    """

    size: int

    def __post_init__(self) -> None:
        if self.size < 1:
            raise ValueError(f"expected a ring of at least 1 cell, found {self.size}")

    @property
    def spec(self) -> str:
        """Such as ``"ring 16"``."""
        return f"ring {self.size}"

    @property
    def cells(self) -> int:
        """Its size."""
        return self.size

    @property
    def diameter(self) -> int:
        """Half way round."""
        return self.size // 2

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """The cell before and the cell after."""
        self.place(cell)
        return (cell - 1) % self.size, (cell + 1) % self.size


@dataclass(frozen=True)
class Complete(_Graph):
    """``size`` cells, each a neighbour of all others.

    Raises:
        ValueError: if there are fewer than 2 cells, or too many links.
    """

    size: int

    def __post_init__(self) -> None:
        if not 2 <= self.size <= MOST_DEGREE + 1:
            raise ValueError(f"expected a complete graph of 2 to {MOST_DEGREE + 1} cells, found {self.size}")

    @property
    def spec(self) -> str:
        """Such as ``"complete 16"``."""
        return f"complete {self.size}"

    @property
    def cells(self) -> int:
        """Its size."""
        return self.size

    @property
    def diameter(self) -> int:
        """One link."""
        return 1

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """All others, by number."""
        self.place(cell)
        return tuple(other for other in range(self.size) if other != cell)


@dataclass(frozen=True)
class Hypercube(_Graph):
    """2^``dimensions`` cells; the numbers of neighbours differ in one bit.

    Raises:
        ValueError: if there is no dimension.
    """

    dimensions: int

    def __post_init__(self) -> None:
        if not 1 <= self.dimensions <= 20:
            raise ValueError(f"expected a hypercube of 1 to 20 dimensions, found {self.dimensions}")

    @property
    def spec(self) -> str:
        """Such as ``"hypercube 4"``."""
        return f"hypercube {self.dimensions}"

    @property
    def cells(self) -> int:
        """2^dimensions."""
        return 1 << self.dimensions

    @property
    def diameter(self) -> int:
        """All bits differ."""
        return self.dimensions

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """From the lowest bit to the highest."""
        self.place(cell)
        return tuple(cell ^ 1 << bit for bit in range(self.dimensions))


@dataclass(frozen=True)
class _Random(_Graph):
    """A graph that networkx builds from a seed, not before somebody asks who neighbours whom: that may take seconds.

    Raises:
        ValueError: if there is no such graph.
    """

    size: int
    degree: int

    def __post_init__(self) -> None:
        if not (3 < self.size <= MOST_RANDOM and 2 <= self.degree <= min(MOST_DEGREE, self.size - 1)):
            raise ValueError(
                f"expected 4 to {MOST_RANDOM} cells of a degree of 2 to {MOST_DEGREE} and less than the cells, "
                f"found {self.size} of degree {self.degree}"
            )
        self._check()

    def _check(self) -> None:
        """Refuse whatever else makes no graph.

        Raises:
            ValueError: says what was expected and what was found.
        """

    @abstractmethod
    def _build(self) -> Any:
        """The graph, connected."""

    @property
    def cells(self) -> int:
        """Its size."""
        return self.size

    @cached_property
    def diameter(self) -> int:
        """Links until news of every cell has reached all: row by row bits tell whose news a cell has."""
        import numpy as np

        table = self.table()
        heard = np.packbits(np.eye(self.size, dtype=bool), axis=1)
        every, links = np.packbits(np.ones(self.size, bool)), 0
        while not np.all(heard == every):
            heard = np.bitwise_or.reduce([heard, *(heard[others] for others in table.T)])
            links += 1
        return links

    @cached_property
    def _graph(self) -> Any:
        return self._build()

    @cached_property
    def _slots(self) -> int:
        most: int = max(degree for _, degree in self._graph.degree())
        return most

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """By number, then the cell itself as often as it has fewer than others."""
        self.place(cell)
        others = sorted(self._graph[cell])
        return (*others, *[cell] * (self._slots - len(others)))


@dataclass(frozen=True)
class RandomRegular(_Random):
    """``size`` cells of the same degree, linked at random, in one piece."""

    seed: int = 1

    def _check(self) -> None:
        _check_seed(self.seed)
        if self.degree < 3:  # a ring has degree 2; at random such graphs are hardly ever in one piece
            raise ValueError(f"expected a degree of 3 or more, found {self.degree}")
        if self.size * self.degree % 2:
            raise ValueError(f"expected an even product of cells and degree, found {self.size} and {self.degree}")

    @property
    def spec(self) -> str:
        """Such as ``"random-regular 16 4 seed 1"``."""
        return f"random-regular {self.size} {self.degree} seed {self.seed}"

    def _build(self) -> Any:
        """The first of the graphs of seed, seed + 1, .. that is in one piece."""
        import networkx

        seed = self.seed
        while True:
            graph = self._drawn(seed)
            if networkx.is_connected(graph):
                return graph
            seed += 1

    def _drawn(self, seed: int) -> Any:
        """Of many links those are drawn that are missing: networkx would look for the last ones for ever."""
        import networkx

        if 2 * self.degree < self.size:
            return networkx.random_regular_graph(self.degree, self.size, seed)
        return networkx.complement(networkx.random_regular_graph(self.size - 1 - self.degree, self.size, seed))


@dataclass(frozen=True)
class SmallWorld(_Random):
    """A ring with links to the ``degree`` nearest, each led elsewhere with a ``probability`` (Watts, Strogatz 1998)."""

    probability: float
    seed: int = 1

    def _check(self) -> None:
        _check_seed(self.seed)
        if self.degree < 4 or self.degree % 2 or not 0.0 <= self.probability <= 1.0:
            found = f"{self.degree} and {self.probability:g}"
            raise ValueError(f"expected an even degree of 4 or more, and a probability, found {found}")

    @property
    def spec(self) -> str:
        """Such as ``"small-world 16 4 0.1 seed 1"``."""
        return f"small-world {self.size} {self.degree} {self.probability!r} seed {self.seed}"

    def _build(self) -> Any:
        import networkx

        return networkx.connected_watts_strogatz_graph(self.size, self.degree, self.probability, _TRIES, self.seed)


def _check_seed(seed: int) -> None:
    if seed > MOST_SEED:
        raise ValueError(f"expected a seed of at most {MOST_SEED}, found {seed}")
