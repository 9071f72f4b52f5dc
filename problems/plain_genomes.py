"""Convert genomes to readable plain values and back, for problems that do not define `decode` and `check`."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from genetics.arrays import Genomes
from genetics.bit_string import BitString
from genetics.coding import Coding
from genetics.permutation import Permutation
from genetics.real_vector import RealVector
from genetics.sequence import Sequence


def field_of(coding: Coding) -> str:
    """Return the field of a solution that holds the individual: the coding's own term, else ``"genome"``."""
    names = {BitString: "integers", RealVector: "genes", Permutation: "order", Sequence: "items"}
    return next((name for kind, name in names.items() if isinstance(coding, kind)), "genome")


def to_plain(coding: Coding, genome: Genomes) -> dict[str, Any]:
    """Return the integers, genes, order or items that a genome of shape (genome_bytes,) codes.

    For a user's own coding, return the genome's bytes as integers: their meaning is not known here.
    """
    match coding:
        case BitString():
            values: NDArray[Any] = coding.integers(genome[None])[0]
        case RealVector():
            values = coding.genes(genome[None])[0]
        case Permutation():
            values = coding.orders(genome[None])[0]
        case Sequence():
            values = coding.items(genome)
        case _:
            values = genome
    return {field_of(coding): values.tolist()}


def from_plain(coding: Coding, plain: dict[str, Any]) -> Genomes:
    """Return the genome of an individual in the format of `to_plain`; other keys of ``plain`` are ignored.

    Raises:
        ValueError: if the coding has no such individual; the message says what was expected.
    """
    name = field_of(coding)
    try:
        genome = _genome_of(coding, plain[name])
    except (KeyError, TypeError, ValueError, OverflowError):
        genome = None
    if genome is None or not coding.alphabet.admits(genome):  # right in form, but perhaps out of bounds
        raise ValueError(f"expected a field {name!r} with {_expected(coding)}")
    return genome


def _genome_of(coding: Coding, values: Any) -> Genomes:
    match coding:
        case BitString():
            genome: Genomes = coding.encode(_integers(values).reshape(1, coding.parameters))[0]
        case RealVector():
            if not all(type(value) in (int, float) for value in values):
                raise ValueError
            genome = np.array(values, np.float64).view(np.uint8)
        case Sequence():
            genome = coding.encode(_integers(values))
        case _:
            numbers = _integers(values)
            if np.any((numbers < 0) | (numbers > 0xFF)):
                raise ValueError
            genome = numbers.astype(np.uint8)
    return genome


def _integers(values: Any) -> NDArray[np.int64]:
    """Return an array of integers.

    Raises:
        ValueError: if a value is no integer, or is a bool or a float, both of which numpy would convert silently.
    """
    array = np.array(values, dtype=object)
    if not all(type(value) is int for value in array.flat):
        raise ValueError
    return array.astype(np.int64)


def _expected(coding: Coding) -> str:
    """Return what a valid individual consists of, for an error message."""
    match coding:
        case BitString():
            return f"{coding.parameters} integers from 0 to {(1 << coding.bits) - 1}"
        case RealVector():
            return f"{coding.dimension} numbers from {coding.low} to {coding.high}"
        case Permutation():
            return f"the integers from 0 to {coding.size - 1}, each once"
        case Sequence():
            return f"{coding.least} to {coding.most} items within {list(coding.genes)}"
        case _:
            return f"the {coding.genome_bytes} bytes of an individual, as integers"
