"""Counter-based randomness: every draw is a pure function of (seed, cell, generation, purpose, index, number).

There is no stored state. So a cell draws the same numbers in a process of its own as beside a million others in the
simulator, and a run can be replayed from any generation. A sequential generator for each cell would need its state to
be sent, kept and restored wherever a cell moves.

The generator is Philox4x32-10 (Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3", 2011), whose
128-bit counter holds the coordinates of the draw.
"""

from typing import Any

import numpy as np

from lowlevel.compiled import inlined, subroutine

# The purposes of draws. Two purposes never share a counter. The numbers are part of every run that is to be replayed:
# changing one changes all results.
INITIAL = 0  # first demes
SELECT = 1  # parents
CROSS = 2
MUTATE = 3
FLIP_ONE = 4  # the one-bit mutation
DELAY = 5  # the simulator's model of asynchronous nodes
TIE = 6  # which of several equally fit individuals
_PURPOSES = 8  # a power of two above the last one: cell and purpose share a counter word

_LOW = np.uint64(0xFFFFFFFF)
_HALF = np.uint64(32)
_MULTIPLIER_0 = np.uint64(0xD2511F53)
_MULTIPLIER_1 = np.uint64(0xCD9E8D57)
_WEYL_0 = np.uint64(0x9E3779B9)
_WEYL_1 = np.uint64(0xBB67AE85)
_TO_UNIT = 2.0**-53


@inlined
def philox(c0: Any, c1: Any, c2: Any, c3: Any, k0: Any, k1: Any) -> Any:
    """Return ten rounds of Philox4x32 on four counter words and two key words, each a uint64 below 2**32."""
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
    """Return 64 random bits, a uint64.

    The caller must not use the same coordinates twice for different things.

    Args:
        seed: the Philox key, a uint64.
        cell: the cell, below 2**20.
        generation: the generation; only its low 32 bits count.
        purpose: one of the constants of this module.
        index: the couple or individual of the cell, below 2**32.
        number: the running number of the draw for that couple or individual, below 2**32.
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
    """Fill ``into`` with all 128 bits of the draws from number ``first`` on.

    ``into`` is uint32 of shape (4, draws); each column gets the four words of one draw. LLVM vectorises this loop, so
    16 draws or more are many times faster than calls of `draw`, which also uses only half of the bits.
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
    """Turn 64 random bits into a float in [0, 1), a multiple of 2**-53. It uses the high 53 bits."""
    return np.float64(bits >> np.uint64(11)) * _TO_UNIT


@inlined
def below(bits: Any, limit: Any) -> Any:
    """Turn 64 random bits into an integer in [0, limit), for a limit below 2**31. It uses the high 32 bits only.

    By multiplication instead of a remainder; no value's probability is off by more than 2**-32.
    """
    return np.int64(((bits >> _HALF) * np.uint64(limit)) >> _HALF)


@subroutine
def normal(first: Any, second: Any) -> Any:
    """Turn twice 64 random bits into a standard normal number (Box and Muller)."""
    return np.sqrt(-2.0 * np.log(1.0 - unit(first))) * np.cos(2.0 * np.pi * unit(second))
