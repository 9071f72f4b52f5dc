"""Declarations of the memory that Python and compiled code share: tables of pointers to arrays, and rows of integers.

Compiled code reads a place by its number, which must be a constant of a module. Python fills all places by name. Both
follow from one declaration, a line for each place, so that no two lists of the same names must be kept in one order:

    _TABLE = TableLayout()
    _HEADER = _TABLE.integers("header")  # a constant: the number of the place, for compiled code
    _FITNESS = _TABLE.reals("fitness")

    table = _TABLE.build(header=header, fitness=fitness)  # every place, by its name

A constant is named as its place, in capitals; `tests/node/engine/test_layout.py` holds that, and that compiled code
reads each place as the type that it has.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from genetics.operators import Table, pointers


class TableLayout:
    """The places of a table of pointers: the name of each, and the type of the elements of its array."""

    def __init__(self) -> None:
        self.kinds: dict[str, type[np.generic]] = {}

    def __len__(self) -> int:
        return len(self.kinds)

    def integers(self, name: str) -> int:
        """Declare the next place, of an int64 array; return its number."""
        return self._declare(name, np.int64)

    def reals(self, name: str) -> int:
        """Declare the next place, of a float64 array; return its number."""
        return self._declare(name, np.float64)

    def octets(self, name: str) -> int:
        """Declare the next place, of a uint8 array; return its number."""
        return self._declare(name, np.uint8)

    def _declare(self, name: str, kind: type[np.generic]) -> int:
        assert name not in self.kinds, f"{name} is declared twice"
        self.kinds[name] = kind
        return len(self.kinds) - 1

    def build(self, **arrays: NDArray[Any]) -> Table:
        """Return a table that points to these arrays, one for each place.

        The table holds bare addresses: the arrays must outlive it, and must not be replaced.
        """
        _same_names(arrays, self.kinds)
        for name, kind in self.kinds.items():
            # Compiled code takes the memory for what the declaration says, so another type would be silent corruption.
            assert arrays[name].dtype == kind, f"{name} is of {arrays[name].dtype}, not {np.dtype(kind)}"
        return pointers(*(arrays[name] for name in self.kinds))


class RowLayout:
    """The columns of a row of int64 numbers, each with a name."""

    def __init__(self) -> None:
        self.names: list[str] = []

    def __len__(self) -> int:
        return len(self.names)

    def column(self, name: str) -> int:
        """Declare the next column; return its number."""
        assert name not in self.names, f"{name} is declared twice"
        self.names.append(name)
        return len(self.names) - 1

    def zeros(self) -> NDArray[np.int64]:
        """Return a row of zeros, shape (columns,)."""
        return np.zeros(len(self), np.int64)

    def build(self, **values: Any) -> NDArray[np.int64]:
        """Return a row of these values, one for each column, shape (columns,)."""
        _same_names(values, self.names)
        return np.array([values[name] for name in self.names], np.int64)


def _same_names(given: Any, declared: Any) -> None:
    assert given.keys() == set(declared), f"not as declared: {', '.join(sorted(given.keys() ^ set(declared)))}"
