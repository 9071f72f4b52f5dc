"""What a receiver of exchange messages accepts. Importing this loads no compiled code."""

from dataclasses import dataclass

from genetics.coding import Alphabet

# Upper bounds, not exact sizes: with every integer at its longest, the fields outside the list of emigrants take less
# than 100 bytes, and an emigrant takes 15 bytes beside its genome (array, length of the genome, float64).
_OVERHEAD = 256  # bytes of a message beside its genomes
_EACH = 24  # bytes of an emigrant beside its genome


def most_bytes(genome_bytes: int, emigrants: int) -> int:
    """Return an upper bound, in bytes, of a valid message; the one genome beside the emigrants' is the champion's."""
    return _OVERHEAD + genome_bytes + emigrants * (_EACH + genome_bytes)


@dataclass(frozen=True)
class Limits:
    """What a receiver accepts in messages of its present job.

    Attributes:
        genome_bytes: the size of a genome, in bytes; in a message it may be shorter (`wire.exchange.Messages.encode`).
        emigrants: the exact number of emigrants in a message.
        cells: the number of cells; a champion's cell of birth must be below it.
        alphabet: which genomes the job's coding can make.
        most_state_bytes: the most bytes of a state that a message may carry; 0 if none may.
    """

    genome_bytes: int
    emigrants: int
    cells: int
    alphabet: Alphabet
    most_state_bytes: int = 0

    @property
    def most_bytes(self) -> int:
        """An upper bound, in bytes, of a valid message. A longer payload is refused before any of it is read."""
        return self.most_bytes_without_state + self.most_state_bytes

    @property
    def most_bytes_without_state(self) -> int:
        """An upper bound, in bytes, of a message without a state."""
        return most_bytes(self.genome_bytes, self.emigrants)
