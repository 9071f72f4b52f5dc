"""A life's digest is that of its packed records, in however many pieces it is made."""

import hashlib
import struct

import numpy as np
import pytest

from node.engine.history import History


def lives(rows, deme, genome_bytes, generations):
    rng = np.random.default_rng(rows + generations)
    genomes = rng.integers(0, 256, (generations, rows, deme, genome_bytes), np.uint8)
    fitness = rng.choice([0.0, -0.0, 1.5, np.inf, rng.random()], (generations, rows, deme))
    return genomes, fitness


def expected(row, genomes, fitness, first=0):
    digest = hashlib.sha256()
    for generation, (deme, its_fitness) in enumerate(zip(genomes[:, row], fitness[:, row], strict=True)):
        values = its_fitness.tolist()
        digest.update(struct.pack("<q", first + generation) + deme.tobytes() + struct.pack(f"<{len(values)}d", *values))
    return digest.digest()


@pytest.mark.parametrize("generations", [0, 1, 2, 200])
@pytest.mark.parametrize(("rows", "deme", "genome_bytes"), [(1, 1, 5), (1, 3, 8), (2, 1, 1), (5, 2, 3), (100, 1, 2)])
def test_a_digest_is_that_of_the_packed_records(rows, deme, genome_bytes, generations):
    genomes, fitness = lives(rows, deme, genome_bytes, generations)
    history = History(rows, deme, genome_bytes)
    for generation in range(generations):
        history.note(generation, genomes[generation], fitness[generation])
    assert history.digests() == [expected(row, genomes, fitness) for row in range(rows)]


def test_asking_for_digests_changes_nothing():
    genomes, fitness = lives(2, 1, 4, 150)
    history = History(2, 1, 4)
    for generation in range(150):
        history.note(generation, genomes[generation], fitness[generation])
        so_far = [expected(row, genomes[: generation + 1], fitness[: generation + 1]) for row in range(2)]
        if generation % 7 == 0:
            assert history.digests() == so_far
            assert history.digests() == so_far
    assert history.digests() == [expected(row, genomes, fitness) for row in range(2)]
