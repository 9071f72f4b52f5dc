"""The names of the array types that the whole program uses."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Genomes = NDArray[np.uint8]  # (..., genome_bytes)
Fitness = NDArray[np.float64]  # (...), lower is better, +inf infeasible, never NaN
Cells = NDArray[np.int64]  # (rows,), the cell that each row stands for
Evaluate = Callable[[Genomes], Fitness]  # (n, genome_bytes) to (n,)


def writable(genomes: Genomes) -> Genomes:
    """Return ``genomes`` in the form that compiled signatures require: contiguous and writable. Copy only if needed."""
    return genomes if genomes.flags.carray else np.require(genomes, np.uint8, ["C", "W"])
