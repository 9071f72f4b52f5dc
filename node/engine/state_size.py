"""How long a cell's state is (`node.engine.state`), and how often it is sent. Importing this loads no compiled code."""

from wire.exchange_layout import HEADER

MOST_BYTES = 64 << 10
"""The longest state that cells keep; with larger demes none is kept, and a dead cell gets a neighbour's deme."""

LEAST_DISTANCE = 4
"""The least number of messages from one state to the next.

Dead cells that are linked with each other go on from the same generation. The latest states that are kept of them must
have one in common, although some cells were ahead.
"""

MOST_IMPROVEMENTS = 64
"""The most improvements in a state: earlier ones are missing in the report of a process that goes on from it."""

_IMPROVEMENT_BYTES = 24
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
