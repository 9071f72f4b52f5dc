"""Digests that identify a run: for each cell one over generation number, genomes and fitness of all its generations."""

import hashlib

import numpy as np

from genetics import Fitness, Genomes

# Records are collected before they are digested, since a digest of few bytes costs mostly its call: so many over all
# rows, but no more than these bytes hold.
_RECORDS = 64
_BYTES = 1 << 16
_ROWS = 1024  # rows whose records there is room for; with more rows each generation is digested at once, in blocks


class History:
    """A SHA-256 digest for each of some rows of cells, over all their generations.

    The layout of a record is part of the digest, so it must never change: a little-endian int64 (generation), the
    genomes, and the fitness as little-endian float64, packed.

    Attributes:
        records: room for records not digested yet, shape (rows, records, bytes); of at most 1024 rows.
        counts: `noted` as an array, shape (1,), which compiled code increments.
        most: the number of records in each row at which they are digested.
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
        """The number of records of each row not digested yet; less than `most`, so there is room for another."""
        return self.counts.item()

    def note(self, generation: int, genomes: Genomes, fitness: Fitness) -> None:
        """Add a generation: genomes of shape (rows, deme, genome_bytes), fitness of shape (rows, deme)."""
        self._generation[:, self.noted] = generation
        if len(genomes) <= _ROWS:
            self._genomes[:, self.noted] = genomes
            self._fitness[:, self.noted] = fitness
            self.counts += 1
            self.digest_if_full()
        else:
            self._digest_now(genomes, fitness)

    def digest_if_full(self) -> None:
        """Digest the records if they are full; call it after writing and counting some, here or in compiled code."""
        if self.noted == self.most:
            self._digest()

    def digests(self) -> list[bytes]:
        """Return each row's digest over all that was noted so far; more may follow."""
        self._digest()
        return [digest.digest() for digest in self._digests]

    def _digest(self) -> None:
        if self.noted:
            for digest, records in zip(self._digests, self.records, strict=True):
                digest.update(records[: self.noted].data)
        self.counts[:] = 0

    def _digest_now(self, genomes: Genomes, fitness: Fitness) -> None:
        """Digest one generation of more rows than there is room for, block by block."""
        for first in range(0, len(genomes), _ROWS):
            block = slice(first, first + _ROWS)
            digests = self._digests[block]
            self._genomes[: len(digests), 0] = genomes[block]
            self._fitness[: len(digests), 0] = fitness[block]
            for digest, record in zip(digests, self.records[: len(digests), 0], strict=True):
                digest.update(record)
