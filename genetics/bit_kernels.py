"""The compiled loops of packed bit strings, over rows of cells.

Bit 0 is the most significant bit of byte 0. Bits beyond ``length`` stay 0, so that equal individuals have equal bytes.
"""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Genomes
from genetics.operators import MUTATE_ONE_BIT, VARIATION, Table
from genetics.randomness import CROSS, FLIP_ONE, INITIAL, MUTATE, below, draw, unit
from lowlevel import pointers
from lowlevel.compiled import kernel, subroutine


@subroutine
def _clear_tail(genome: Any, length: Any) -> Any:
    """Set the bits beyond ``length`` to 0."""
    spare = 8 * genome.size - length
    genome[-1] &= np.uint8((0xFF << spare) & 0xFF)


@subroutine
def _flip(genome: Any, bit: Any) -> Any:
    genome[bit >> 3] ^= np.uint8(0x80 >> (bit & 7))


@kernel("uint8[:,:,::1](uint64, int64[::1], int64, int64)")
def random(seed: np.uint64, cells: Cells, deme: int, length: int) -> Genomes:
    """Return uniformly random demes, shape (rows, deme, bytes)."""
    size = (length + 7) // 8
    genomes = np.empty((cells.size, deme, size), np.uint8)
    for row in range(cells.size):
        for individual in range(deme):
            genome = genomes[row, individual]
            for byte in range(size):
                if byte % 8 == 0:  # one draw is enough for eight bytes
                    bits = draw(seed, cells[row], 0, INITIAL, individual, byte // 8)
                genome[byte] = np.uint8(bits >> np.uint64(8 * (byte % 8)) & np.uint64(0xFF))
            _clear_tail(genome, length)
    return genomes


@subroutine
def _one_point(first: Any, second: Any, left_right: Any, right_left: Any, cut: Any) -> Any:
    """Join the bits before ``cut`` of one parent with the rest of the other, and the other way round."""
    whole = cut >> 3
    for byte in range(first.size):
        if byte < whole:
            keep = np.uint8(0xFF)
        elif byte == whole:
            keep = np.uint8((0xFF00 >> (cut & 7)) & 0xFF)
        else:
            keep = np.uint8(0)
        left_right[byte] = (first[byte] & keep) | (second[byte] & ~keep)
        right_left[byte] = (second[byte] & keep) | (first[byte] & ~keep)


@subroutine
def _uniform(first: Any, second: Any, one: Any, other: Any, seed: Any, cell: Any, generation: Any, couple: Any) -> Any:
    """Take each bit from either parent with equal probability; the other offspring gets the other parent's bit."""
    for byte in range(first.size):
        if byte % 8 == 0:
            bits = draw(seed, cell, generation, CROSS, couple, byte // 8)
        keep = np.uint8(bits >> np.uint64(8 * (byte % 8)) & np.uint64(0xFF))
        one[byte] = (first[byte] & keep) | (second[byte] & ~keep)
        other[byte] = (second[byte] & keep) | (first[byte] & ~keep)


@subroutine
def _mutate(genome: Any, scale: Any, length: Any, seed: Any, cell: Any, generation: Any, individual: Any) -> Any:
    """Flip each bit with a probability of 1 − exp(1 / ``scale``).

    The loop draws the gap to the next flip, which is geometrically distributed, instead of one number for each bit:
    mutation rates are small, so this takes a few draws for each genome.
    """
    last: Any = -1
    for number in range(length):
        gap = np.log1p(-unit(draw(seed, cell, generation, MUTATE, individual, number))) * scale
        if gap >= length - last - 1:  # compared as floats: a tiny rate gives gaps beyond any integer
            return
        last += 1 + np.int64(gap)
        _flip(genome, last)


@subroutine
def _cross(
    first: Any,
    second: Any,
    one: Any,
    other: Any,
    seed: Any,
    cell: Any,
    generation: Any,
    couple: Any,
    length: Any,
    uniform: Any,
) -> Any:
    """Make the two offspring of a couple by uniform or one-point crossover."""
    if uniform:
        _uniform(first, second, one, other, seed, cell, generation, couple)
    else:
        cut = length  # a single bit cannot be cut: the offspring are copies of the parents
        if length > 1:
            cut = 1 + below(draw(seed, cell, generation, CROSS, couple, 0), length - 1)
        _one_point(first, second, one, other, cut)


@subroutine
def _flip_one_bit(individuals: Any, seed: Any, cell: Any, generation: Any, length: Any) -> Any:
    """Flip one random bit of one random individual; return the individual's index."""
    individual = below(draw(seed, cell, generation, FLIP_ONE, 0, 0), individuals.shape[0])
    _flip(individuals[individual], below(draw(seed, cell, generation, FLIP_ONE, 0, 1), length))
    return individual


@subroutine
def recombine_row(
    couples: Any,
    offspring: Any,
    seed: Any,
    cell: Any,
    generation: Any,
    length: Any,
    uniform: Any,
    rate: Any,
) -> Any:
    """Fill one row's offspring, see `recombine`."""
    for couple in range(couples.shape[0]):
        first, second = couples[couple, 0], couples[couple, 1]
        one, other = offspring[2 * couple], offspring[2 * couple + 1]
        _cross(first, second, one, other, seed, cell, generation, couple, length, uniform)
    if rate >= 1.0:  # every bit flips, so there is nothing to draw
        for child in range(offspring.shape[0]):
            for bit in range(length):
                _flip(offspring[child], bit)
    elif rate > 0.0:
        scale = 1.0 / np.log1p(-rate)
        for child in range(offspring.shape[0]):
            _mutate(offspring[child], scale, length, seed, cell, generation, child)


@kernel("uint8[:,:,::1](uint8[:,:,:,::1], uint64, int64[::1], int64, int64, boolean, float64)")
def recombine(
    couples: Genomes,
    seed: np.uint64,
    cells: Cells,
    generation: int,
    length: int,
    uniform: bool,
    rate: float,
) -> Genomes:
    """Return two mutated offspring for each couple: (rows, couples, 2, bytes) to (rows, 2 * couples, bytes).

    ``length`` is the number of bits of a genome, ``uniform`` chooses uniform instead of one-point crossover, and
    ``rate`` is the probability that a bit flips.
    """
    rows, count, _, size = couples.shape
    offspring = np.empty((rows, 2 * count, size), np.uint8)
    for row in range(rows):
        recombine_row(couples[row], offspring[row], seed, cells[row], generation, length, uniform, rate)
    return offspring


@kernel(VARIATION)
def variation(couples: Genomes, offspring: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> None:
    """Fill one row's offspring, see `recombine`. The table has two entries: length and uniform; rate."""
    choices = pointers.integers(table, 0)[0]
    rate = pointers.reals(table, 1)[0, 0]
    recombine_row(couples, offspring, seed, cell, generation, choices[0], choices[1] != 0, rate)


@kernel("int64[::1](uint8[:,:,::1], uint64, int64[::1], int64, int64)")
def mutate_one(individuals: Genomes, seed: np.uint64, cells: Cells, generation: int, length: int) -> Cells:
    """Flip one random bit of one random individual of each row; return the individuals' indices, shape (rows,)."""
    changed = np.empty(cells.size, np.int64)
    for row in range(cells.size):
        changed[row] = _flip_one_bit(individuals[row], seed, cells[row], generation, length)
    return changed


@kernel(MUTATE_ONE_BIT)
def mutate_one_bit(individuals: Genomes, seed: np.uint64, cell: int, generation: int, table: Table) -> int:
    """Flip a bit in one row, see `mutate_one`. The table has one entry: length."""
    changed: int = _flip_one_bit(individuals, seed, cell, generation, pointers.integers(table, 0)[0, 0])
    return changed


@subroutine
def integers_of(genome: Any, bits: Any, gray: Any, values: Any) -> Any:
    """Fill ``values`` with the integers that a genome codes, each of ``bits`` bits.

    In a reflected Gray code each binary digit is the sum modulo 2 of all digits of the code up to it.
    """
    bit = 0
    for parameter in range(values.size):
        value = np.int64(0)
        last = np.int64(0)
        for _ in range(bits):
            digit = np.int64(genome[bit >> 3] >> (7 - (bit & 7))) & 1
            if gray:
                digit ^= last
                last = digit
            value = (value << 1) | digit
            bit += 1
        values[parameter] = value


@kernel("int64[:,::1](uint8[:,::1], int64, int64, boolean)")
def integers(genomes: Genomes, parameters: int, bits: int, gray: bool) -> Cells:
    """Return the integers that genomes code, shape (n, parameters)."""
    values = np.empty((genomes.shape[0], parameters), np.int64)
    for row in range(genomes.shape[0]):
        integers_of(genomes[row], bits, gray, values[row])
    return values
