"""How long a cell's state is (`node.engine.state`), and how often it is sent. Importing this loads no compiled code."""

import numpy as np
from numpy.typing import NDArray

from topologies.parse import MOST_CELLS
from wire.exchange_layout import HEADER

MOST_BYTES = 64 << 10
"""The longest state that cells keep; with larger demes none is kept, and a dead cell gets a neighbour's deme."""

LEAST_DISTANCE = 4
"""The least number of messages from one state to the next.

Dead cells that are linked with each other go on from the same generation. The latest states that are kept of them must
have one in common, although some cells were ahead.
"""

MOST_IMPROVEMENTS = 24
"""The most improvements in a state: earlier ones are missing in the report of a process that goes on from it."""

BIRTHPLACE_BITS = (MOST_CELLS - 1).bit_length()
"""An improvement is two numbers: its fitness, and the generation of its birth with the cell in these lowest bits."""

_IMPROVEMENT_BYTES = 16
_SHA256 = 17  # numbers of a digest, `node.engine.sha256.STATE`


def state_bytes(deme: int, genome_bytes: int, emigrants: int) -> int:
    """Return the bytes of a state without any improvement; 0 if it is too long to be kept."""
    size = bytes_without_genomes(deme, emigrants, 0) + (emigrants + 1 + deme) * genome_bytes
    return size if size <= MOST_BYTES else 0


def bytes_without_genomes(deme: int, emigrants: int, improvements: int) -> int:
    """Return the bytes of a state beside the genomes of the deme and of the cell's message."""
    numbers = HEADER + 1 + _SHA256 + 2 + (emigrants + 1) + deme
    return 1 + 8 * numbers + _IMPROVEMENT_BYTES * improvements


def most_state_bytes(without_improvements: int) -> int:
    """Return the bytes of the longest state, given those of one without any improvement."""
    return without_improvements + _IMPROVEMENT_BYTES * MOST_IMPROVEMENTS if without_improvements else 0


def births_of(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the generation and the cell of improvements, shape (improvements, 2), given their numbers in a state."""
    return np.stack([numbers >> BIRTHPLACE_BITS, numbers & (1 << BIRTHPLACE_BITS) - 1], axis=-1)
