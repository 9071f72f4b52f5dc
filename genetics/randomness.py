"""Counter-based randomness: every draw is a pure function of (seed, cell, generation, purpose, index, number).

There is no stored state, so a cell draws the same numbers whether it lives in a process of its own or beside a million
others, and a run can be replayed from any generation. The generator is Philox4x32-10 (Salmon, Moraes, Dror, Shaw,
"Parallel random numbers: as easy as 1, 2, 3", 2011), whose 128-bit counter holds the coordinates of the draw.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import inlined, subroutine

# What a draw is for. Two purposes never share a counter.
INITIAL = 0
SELECT = 1
CROSS = 2
MUTATE = 3
STRAY = 4
DELAY = 5
TIE = 6
_PURPOSES = 8

_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_MULTIPLIER_0 = np.uint64(0xD2511F53)
_MULTIPLIER_1 = np.uint64(0xCD9E8D57)
_WEYL_0 = np.uint64(0x9E3779B9)
_WEYL_1 = np.uint64(0xBB67AE85)
_TO_UNIT = 2.0**-53


@inlined
def philox(c0: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> Any:
    """Ten rounds of Philox4x32 on four counter words and two key words, each a uint64 below 2**32."""
    for _ in range(10):
        product_0 = _MULTIPLIER_0 * c0
        product_1 = _MULTIPLIER_1 * c2
        c0 = (product_1 >> _HALF) ^ c1 ^ k0
        c1 = product_1 & _LOW
        c2 = (product_0 >> _HALF) ^ c3 ^ k1
        c3 = product_0 & _LOW
        k0 = (k0 + _WEYL_0) & _LOW
        k1 = (k1 + _WEYL_1) & _LOW
    return c0, c1, c2, c3


@inlined
def draw(seed: Any, cell: Any, generation: Any, purpose: Any, index: Any, number: Any) -> Any:
    """64 random bits.

    Args:
        seed: uint64, the Philox key.
        cell: at most 2**20 of them.
        generation: int below 2**32.
        purpose: one of the constants of this module.
        index: which couple or individual of the cell, below 2**32.
        number: the running number of the draw for that individual, below 2**32.
    """
    high, low, _, _ = philox(
        np.uint64(number),
        np.uint64(index),
        np.uint64(generation) & _LOW,
        np.uint64(cell * _PURPOSES + purpose),
        np.uint64(seed) & _LOW,
        np.uint64(seed) >> _HALF,
    )
    return (high << _HALF) | low


@inlined
def words(into: Any, seed: Any, cell: Any, generation: Any, purpose: Any, index: Any, first: Any) -> Any:
    """All 128 bits of the draws from number ``first`` on, many times quicker than one by one if there are 16 or more.

    ``into``, uint32 of shape (4, draws), gets the four words of each draw in a column.
    """
    for place in range(into.shape[1]):
        into[0, place], into[1, place], into[2, place], into[3, place] = philox(
            np.uint64(first + place),
            np.uint64(index),
            np.uint64(generation) & _LOW,
            np.uint64(cell * _PURPOSES + purpose),
            np.uint64(seed) & _LOW,
            np.uint64(seed) >> _HALF,
        )


@inlined
def unit(bits: Any) -> Any:
    """From 64 random bits, a float in [0, 1)."""
    return np.float64(bits >> np.uint64(11)) * _TO_UNIT


@inlined
def below(bits: Any, limit: Any) -> Any:
    """From 64 random bits, an integer in [0, limit) for a limit below 2**31."""
    return np.int64(((bits >> _HALF) * np.uint64(limit)) >> _HALF)


@subroutine
def normal(first: Any, second: Any) -> Any:
    """From twice 64 random bits, a standard normal number (Box and Muller)."""
    return np.sqrt(-2.0 * np.log(1.0 - unit(first))) * np.cos(2.0 * np.pi * unit(second))
