"""What identifies a run: each cell's digest over (generation, deme) of each of its generations."""

import hashlib

import numpy as np

from genetics import Fitness, Genomes

_RECORDS = 64  # kept before they are digested, over all rows: a digest's cost is mostly that of being called


class History:
    """SHA-256 digests of the lives of some rows of cells."""

    def __init__(self, rows: int, deme: int, genome_bytes: int) -> None:
        record = np.dtype([("generation", "<i8"), ("genomes", "u1", (deme, genome_bytes)), ("fitness", "<f8", (deme,))])
        self._records = np.zeros((rows, max(1, _RECORDS // rows)), record)
        self._generation = self._records["generation"]
        self._genomes = self._records["genomes"]
        self._fitness = self._records["fitness"]
        self._bytes = record.itemsize
        self._flat = self._records.view(np.uint8).reshape(rows, -1)
        self._digests = [hashlib.sha256() for _ in range(rows)]
        self._noted = 0

    def note(self, generation: int, genomes: Genomes, fitness: Fitness) -> None:
        """Take in a generation: genomes (rows, deme, genome_bytes), fitness (rows, deme)."""
        place = self._noted
        self._generation[:, place] = generation
        self._genomes[:, place] = genomes
        self._fitness[:, place] = fitness
        self._noted = place + 1
        if self._noted == self._records.shape[1]:
            self._digest()

    def digests(self) -> list[bytes]:
        """Of the rows, over all that was noted so far."""
        self._digest()
        return [digest.digest() for digest in self._digests]

    def _digest(self) -> None:
        noted = self._noted * self._bytes
        for digest, records in zip(self._digests, self._flat, strict=True):
            digest.update(records[:noted].data)
        self._noted = 0
