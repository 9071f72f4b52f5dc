"""Individuals as plain values that people can read: there and back, and what is none."""

import json
from typing import ClassVar

import numpy as np
import pytest

from genetics.bit_string import BitString
from genetics.coding import Alphabet, Keys
from genetics.permutation import Permutation
from genetics.real_vector import RealVector
from genetics.sequence import Sequence
from problems.plain_genomes import from_plain, to_plain

KEYS = Keys(np.array([0]), np.uint64(7), 0)


class Pairs(Sequence):
    """Of one to three items of two genes."""

    crossovers: ClassVar = ("none",)

    def initialise(self):
        raise NotImplementedError

    variation = initialise


class Moves:
    """A coding that a user has made."""

    genome_bytes = 3
    alphabet = Alphabet.of_bits(np.full(3, 0b11, np.uint8))


PAIRS = Pairs(1, 3, [(0, 9), (5, 300)])


def drawn(coding):
    return coding.random(KEYS, 1)[0, 0]


@pytest.mark.parametrize(
    ("coding", "genome", "field"),
    [
        (BitString(3, 6, gray=True), drawn(BitString(3, 6, gray=True)), "integers"),
        (BitString(2, 62), drawn(BitString(2, 62)), "integers"),
        (RealVector(4, -0.1, 1.0), drawn(RealVector(4, -0.1, 1.0)), "genes"),
        (Permutation(6), drawn(Permutation(6)), "order"),
        (PAIRS, PAIRS.encode([[9, 300], [0, 5]]), "items"),
        (Moves(), np.array([3, 0, 2], np.uint8), "genome"),
    ],
)
def test_an_individual_comes_back_from_json_bit_for_bit(coding, genome, field):
    plain = to_plain(coding, genome)
    assert list(plain) == [field]
    assert isinstance(plain[field], list)
    assert from_plain(coding, json.loads(json.dumps(plain))).tobytes() == genome.tobytes()


def test_values_are_those_that_the_coding_stands_for():
    gray = BitString(2, 3, gray=True)
    assert to_plain(gray, gray.encode([[5, 2]])[0]) == {"integers": [5, 2]}
    assert to_plain(RealVector(2, 0.0, 1.0), np.array([0.25, 1.0]).view(np.uint8)) == {"genes": [0.25, 1.0]}
    assert to_plain(PAIRS, PAIRS.encode([[9, 300]])) == {"items": [[9, 300]]}


@pytest.mark.parametrize(
    ("coding", "plain", "expected"),
    [
        (RealVector(2, 0.0, 1.0), {"genes": [0.5, 1.5]}, "'genes' with 2 numbers from 0.0 to 1.0"),
        (RealVector(2, 0.0, 1.0), {"genes": [0.5, float("nan")]}, "'genes' with 2 numbers"),
        (RealVector(2, 0.0, 1.0), {"genes": ["0.5", "0.5"]}, "'genes' with 2 numbers"),
        (Permutation(3), {"order": [0, 1, 1]}, "'order' with the integers from 0 to 2, each once"),
        (PAIRS, {"items": [[9, 4]]}, "'items' with 1 to 3 items within"),
        (Moves(), {"genome": [4, 0, 0]}, "'genome' with the 3 bytes of an individual, as integers"),
        (Moves(), {"genome": [-1, 0, 0]}, "'genome' with the 3 bytes"),
    ],
)
def test_what_codes_no_individual_is_refused(coding, plain, expected):
    with pytest.raises(ValueError, match=f"^expected a field {expected}"):
        from_plain(coding, plain)
