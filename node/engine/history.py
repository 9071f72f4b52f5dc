"""Digests that identify a run: for each cell one over generation number, genomes and fitness of all its generations."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from genetics import Fitness, Genomes
from lowlevel.compiled import kernel, subroutine
from node.engine import sha256


@subroutine
def digest_generation(state: Any, record: Any, generation: Any, genomes: Any, fitness: Any) -> Any:
    """Add a generation of one cell to its digest: genomes of shape (deme, genome_bytes), fitness of shape (deme,).

    ``record`` is room for what is digested. Its layout is part of the digest, so it must never change: a little-endian
    int64 (the generation), the genomes, and the fitness as little-endian float64, without gaps. Bytes are written one
    by one, since the fitness may begin at any offset.
    """
    for place in range(8):
        record[place] = (generation >> (8 * place)) & 0xFF
    size = genomes.shape[1]
    for individual in range(genomes.shape[0]):
        start = 8 + size * individual
        record[start : start + size] = genomes[individual]
    record[8 + genomes.size :] = fitness.view(np.uint8)
    sha256.update(state, record)


@kernel("void(int64[:, ::1])")
def _begin(states: Any) -> None:
    for row in range(len(states)):
        sha256.begin(states[row])


@kernel("void(int64[:, ::1], uint8[::1], int64, uint8[:, :, ::1], float64[:, ::1])")
def _digest(states: Any, record: Any, generation: int, genomes: Genomes, fitness: Fitness) -> None:
    for row in range(len(states)):
        digest_generation(states[row], record, generation, genomes[row], fitness[row])


@kernel("void(int64[:, ::1], uint8[:, ::1])")
def _finish(states: Any, digests: Any) -> None:
    for row in range(len(states)):
        sha256.finish(states[row], digests[row])


class History:
    """A SHA-256 digest for each of some rows of cells, over all their generations.

    Attributes:
        states: the digests so far, shape (rows, `sha256.STATE`); compiled generations go on with them.
        record: room for what is digested of one generation, shape (bytes,).
    """

    def __init__(self, rows: int, deme: int, genome_bytes: int) -> None:
        self.states = np.zeros((rows, sha256.STATE), np.int64)
        self.record = np.zeros(8 + deme * (genome_bytes + 8), np.uint8)
        _begin(self.states)

    def note(self, generation: int, genomes: Genomes, fitness: Fitness) -> None:
        """Add a generation: genomes of shape (rows, deme, genome_bytes), fitness of shape (rows, deme)."""
        _digest(self.states, self.record, generation, genomes, fitness)

    def digests(self) -> list[bytes]:
        """Return each row's digest over all that was noted so far; more may follow."""
        return digests_of(self.states)


def digests_of(states: NDArray[np.int64]) -> list[bytes]:
    """Return the digest of each of some states, shape (rows, `sha256.STATE`), which stay as they are."""
    digests = np.empty((len(states), 32), np.uint8)
    _finish(states, digests)
    return [digest.tobytes() for digest in digests]
