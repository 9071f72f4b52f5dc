"""The compiled side of `genetics.sequence`: what a genome of variable length holds, and whether it is one."""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Genomes
from lowlevel.compiled import kernel, subroutine

LEAST, MOST = 0, 1
"""Places in the limits: the fewest and the most items; then the least and the greatest of each gene of an item; and
last whether the first genes of all items must differ."""


@subroutine
def numbers_of(genome: Any) -> Any:
    """A view of a genome as uint16 numbers: how many items, then their genes, then zeros."""
    return genome.view(np.uint16)


@subroutine
def _are_distinct(numbers: Any, count: Any, width: Any, greatest: Any) -> Any:
    """Whether the first genes of all items differ; none is above ``greatest``."""
    known = np.zeros(greatest + 1, np.bool_)
    for place in range(1, 1 + count * width, width):
        if known[numbers[place]]:
            return False
        known[numbers[place]] = True
    return True


@subroutine
def is_sound_sequence(genome: Any, limits: Any) -> Any:
    """Whether the number of items and each gene keep to the limits, and nothing follows the last item."""
    numbers, width = numbers_of(genome), (limits.size - 3) // 2
    count = np.int64(numbers[0])
    if count < limits[LEAST] or count > limits[MOST]:
        return False
    for place in range(1, numbers.size):
        if place > count * width:
            if numbers[place] != 0:
                return False
        else:
            gene = 2 + 2 * ((place - 1) % width)
            if not limits[gene] <= numbers[place] <= limits[gene + 1]:
                return False
    return limits[-1] == 0 or _are_distinct(numbers, count, width, limits[3])


@kernel("boolean(uint8[::1], int64[::1])")
def is_sound(genome: Genomes, limits: Cells) -> bool:
    """`is_sound_sequence` for Python."""
    sound: bool = is_sound_sequence(genome, limits)
    return sound


@subroutine
def clear_after(numbers: Any, count: Any, width: Any) -> Any:
    """Say that there are ``count`` items, and put zeros after them: equal individuals are equal bytes."""
    numbers[0] = count
    numbers[1 + count * width :] = 0
