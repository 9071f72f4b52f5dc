"""The array types of the whole program, named once."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Genomes = NDArray[np.uint8]  # (..., genome_bytes)
Fitness = NDArray[np.float64]  # (...), lower is better, +inf infeasible, never NaN
Cells = NDArray[np.int64]  # (rows,), the cell that each row stands for
Evaluate = Callable[[Genomes], Fitness]  # (n, genome_bytes) to (n,)


def writable(genomes: Genomes) -> Genomes:
    """``genomes`` as compiled signatures want them: in one piece and not read-only; a copy only if they are not."""
    return genomes if genomes.flags.carray else np.require(genomes, np.uint8, ["C", "W"])
