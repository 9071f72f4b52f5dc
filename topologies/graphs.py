"""Topologies that are not rectangles: ring, hypercube, complete graph, and random graphs built by networkx.

Every cell has as many slots as the cell with the most neighbours. A slot that is left over names the cell itself.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MOST_DEGREE = 255
"""The most neighbours of a cell: a node keeps a link to each of them."""
MOST_RANDOM = 1 << 14
"""The most cells of a random graph: finding its diameter takes time and memory that grow with their square."""
MOST_SEED = (1 << 32) - 1
_TRIES = 100  # of networkx, to draw a small world that is connected


@dataclass(frozen=True)
class _Graph(ABC):
    """A topology whose cells have no coordinates but their numbers."""

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
        """Return the neighbours of ``cell``, one for each of its slots."""

    def table(self) -> "NDArray[np.int64]":
        """Return the neighbours of all cells, shape (cells, slots)."""
        import numpy as np

        return np.array([self.neighbours(cell) for cell in range(self.cells)], np.int64)

    def place(self, cell: int) -> tuple[int]:
        """Return (``cell``,), the only coordinate.

        Raises:
            ValueError: if there is no such cell.
        """
        if not 0 <= cell < self.cells:
            raise ValueError(f"expected a cell of {self.spec}, 0 to {self.cells - 1}, found {cell}")
        return (cell,)


@dataclass(frozen=True)
class Ring(_Graph):
    """A ring of ``size`` cells, each linked with the one before and the one after.

    Raises:
        ValueError: if there is not at least one cell.
    """

    size: int

    def __post_init__(self) -> None:
        if self.size < 1:
            raise ValueError(f"expected a ring of at least 1 cell, found {self.size}")

    @property
    def spec(self) -> str:
        """The text that names this topology, such as ``"ring 16"``."""
        return f"ring {self.size}"

    @property
    def cells(self) -> int:
        """The number of cells."""
        return self.size

    @property
    def diameter(self) -> int:
        """The greatest distance between two cells: half way round."""
        return self.size // 2

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """Return the cell before and the cell after."""
        self.place(cell)
        return (cell - 1) % self.size, (cell + 1) % self.size


@dataclass(frozen=True)
class Complete(_Graph):
    """A complete graph of ``size`` cells: each is a neighbour of all others.

    Raises:
        ValueError: if there are fewer than 2 cells, or too many links.
    """

    size: int

    def __post_init__(self) -> None:
        if not 2 <= self.size <= MOST_DEGREE + 1:
            raise ValueError(f"expected a complete graph of 2 to {MOST_DEGREE + 1} cells, found {self.size}")

    @property
    def spec(self) -> str:
        """The text that names this topology, such as ``"complete 16"``."""
        return f"complete {self.size}"

    @property
    def cells(self) -> int:
        """The number of cells."""
        return self.size

    @property
    def diameter(self) -> int:
        """The greatest distance between two cells: one link."""
        return 1

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """Return all other cells, in the order of their numbers."""
        self.place(cell)
        return tuple(other for other in range(self.size) if other != cell)


@dataclass(frozen=True)
class Hypercube(_Graph):
    """A hypercube of 2^``dimensions`` cells: the numbers of neighbours differ in exactly one bit.

    Raises:
        ValueError: if there are not 1 to 20 dimensions.
    """

    dimensions: int

    def __post_init__(self) -> None:
        if not 1 <= self.dimensions <= 20:
            raise ValueError(f"expected a hypercube of 1 to 20 dimensions, found {self.dimensions}")

    @property
    def spec(self) -> str:
        """The text that names this topology, such as ``"hypercube 4"``."""
        return f"hypercube {self.dimensions}"

    @property
    def cells(self) -> int:
        """The number of cells: 2^dimensions."""
        return 1 << self.dimensions

    @property
    def diameter(self) -> int:
        """The greatest distance between two cells: each link changes one bit, and all may differ."""
        return self.dimensions

    def neighbours(self, cell: int) -> tuple[int, ...]:
        """Return the neighbours of ``cell``, from the one that differs in the lowest bit to the highest."""
        self.place(cell)
        return tuple(cell ^ 1 << bit for bit in range(self.dimensions))


@dataclass(frozen=True)
class _Random(_Graph):
    """A graph that networkx builds from a seed. It is built when neighbours are first asked for: that may take seconds.

    Raises:
        ValueError: if no such graph exists.
    """

    size: int
    degree: int

    def __post_init__(self) -> None:
        if not (3 < self.size <= MOST_RANDOM and 2 <= self.degree <= min(MOST_DEGREE, self.size - 1)):
            raise ValueError(
                f"expected 4 to {MOST_RANDOM} cells and a degree from 2 to {MOST_DEGREE}, "
                f"less than the number of cells, found {self.size} cells of degree {self.degree}"
            )
        self._check()

    def _check(self) -> None:
        """Check what the subclass requires besides.

        Raises:
            ValueError: if no such graph exists.
        """

    @abstractmethod
    def _build(self) -> Any:
        """Return the networkx graph, which must be connected."""

    @property
    def cells(self) -> int:
        """The number of cells."""
        return self.size

    @cached_property
    def diameter(self) -> int:
        """The greatest distance between two cells, found by spreading news of every cell from all cells at once.

        In each step every cell learns what its neighbours know. The diameter is the number of steps until all know all.
        """
        import numpy as np

        table = self.table()
        # Bit c of row r: cell r has news of cell c. Packed, the bits of the largest graph take 32 MiB.
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
        """Return the neighbours of ``cell`` by number, then the cell itself for each slot that is left over."""
        self.place(cell)
        others = sorted(self._graph[cell])
        return (*others, *[cell] * (self._slots - len(others)))


@dataclass(frozen=True)
class RandomRegular(_Random):
    """A random graph of ``size`` cells that all have the same degree; it is connected."""

    seed: int = 1

    def _check(self) -> None:
        _check_seed(self.seed)
        if self.degree < 3:  # random graphs of degree 2 are hardly ever connected; a ring is the one that is
            raise ValueError(f"expected a degree of 3 or more, found {self.degree}")
        if self.size * self.degree % 2:
            raise ValueError(f"expected an even product of cells and degree, found {self.size} and {self.degree}")

    @property
    def spec(self) -> str:
        """The text that names this topology, such as ``"random-regular 16 4 seed 1"``."""
        return f"random-regular {self.size} {self.degree} seed {self.seed}"

    def _build(self) -> Any:
        """Return the first connected graph among those of seed, seed + 1, …."""
        import networkx

        seed = self.seed
        while True:
            graph = self._drawn(seed)
            if networkx.is_connected(graph):
                return graph
            seed += 1

    def _drawn(self, seed: int) -> Any:
        """Draw a graph. Of a dense one draw the complement: networkx would search for the last links for ever."""
        import networkx

        if 2 * self.degree < self.size:
            return networkx.random_regular_graph(self.degree, self.size, seed)
        return networkx.complement(networkx.random_regular_graph(self.size - 1 - self.degree, self.size, seed))


@dataclass(frozen=True)
class SmallWorld(_Random):
    """A small world (Watts and Strogatz 1998): a ring in which each cell is linked to the ``degree`` nearest ones.

    With ``probability`` a link is led to another cell instead.
    """

    probability: float
    seed: int = 1

    def _check(self) -> None:
        _check_seed(self.seed)
        if self.degree < 4 or self.degree % 2 or not 0.0 <= self.probability <= 1.0:
            found = f"{self.degree} and {self.probability:g}"
            raise ValueError(f"expected an even degree of 4 or more and a probability from 0 to 1, found {found}")

    @property
    def spec(self) -> str:
        """The text that names this topology, such as ``"small-world 16 4 0.1 seed 1"``."""
        return f"small-world {self.size} {self.degree} {self.probability!r} seed {self.seed}"

    def _build(self) -> Any:
        import networkx

        return networkx.connected_watts_strogatz_graph(self.size, self.degree, self.probability, _TRIES, self.seed)


def _check_seed(seed: int) -> None:
    if seed > MOST_SEED:
        raise ValueError(f"expected a seed of at most {MOST_SEED}, found {seed}")
