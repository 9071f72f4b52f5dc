"""What identifies a run: each cell's digest over (generation, deme) of each of its generations."""

import hashlib

import numpy as np

from genetics import Fitness, Genomes

_RECORDS = 64  # kept before they are digested, over all rows: a digest's cost is mostly that of being called,
_BYTES = 1 << 16  # unless they are long
_ROWS = 1024  # whose records are made at once; of more rows each generation is digested as it is noted


class History:
    """SHA-256 digests of the lives of some rows of cells.

    Attributes:
        records: room for those not digested yet, shape (rows, records, bytes): generation, genomes, fitness, packed. It
            is for so many rows at a time.
        counts: `noted`, (1,), for compiled code.
        most: at so many they are digested.
    """

    def __init__(self, rows: int, deme: int, genome_bytes: int) -> None:
        record = np.dtype([("generation", "<i8"), ("genomes", "u1", (deme, genome_bytes)), ("fitness", "<f8", (deme,))])
        fields = np.zeros((min(rows, _ROWS), max(1, min(_RECORDS, _BYTES // record.itemsize) // rows)), record)
        self._generation, self._genomes, self._fitness = fields["generation"], fields["genomes"], fields["fitness"]
        self.records = fields.view(np.uint8).reshape(*fields.shape, record.itemsize)
        self.counts = np.zeros(1, np.int64)
        self.most = fields.shape[1]
        self._digests = [hashlib.sha256() for _ in range(rows)]

    @property
    def noted(self) -> int:
        """How many records there are; always less than `most`, so that there is room for another."""
        return self.counts.item()

    def note(self, generation: int, genomes: Genomes, fitness: Fitness) -> None:
        """Take in a generation: genomes (rows, deme, genome_bytes), fitness (rows, deme)."""
        self._generation[:, self.noted] = generation
        if len(genomes) <= _ROWS:
            self._genomes[:, self.noted] = genomes
            self._fitness[:, self.noted] = fitness
            self.counts += 1
            self.went_on()
        else:
            self._digest_now(genomes, fitness)

    def went_on(self) -> None:
        """Some more have been written and counted, here or by compiled code; no more than there was room for."""
        if self.noted == self.most:
            self._digest()

    def digests(self) -> list[bytes]:
        """Of the rows, over all that was noted so far."""
        self._digest()
        return [digest.digest() for digest in self._digests]

    def _digest(self) -> None:
        if self.noted:
            for digest, records in zip(self._digests, self.records, strict=True):
                digest.update(records[: self.noted].data)
        self.counts[:] = 0

    def _digest_now(self, genomes: Genomes, fitness: Fitness) -> None:
        """A record of each row, so many rows at a time."""
        for first in range(0, len(genomes), _ROWS):
            block = slice(first, first + _ROWS)
            digests = self._digests[block]
            self._genomes[: len(digests), 0] = genomes[block]
            self._fitness[: len(digests), 0] = fitness[block]
            for digest, record in zip(digests, self.records[: len(digests), 0], strict=True):
                digest.update(record)
