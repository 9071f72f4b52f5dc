"""The compiled side of `genetics.sequence`: access to genomes of variable length, and the check that one is valid."""

from typing import Any

import numpy as np

from genetics.arrays import Cells, Genomes
from lowlevel.compiled import kernel, subroutine

LEAST, MOST = 0, 1
"""Places in the array of limits: the fewest and the most items. Then follow the least and the greatest value of each
gene of an item, and last 1 if the first genes of all items must differ, else 0."""


@subroutine
def numbers_of(genome: Any) -> Any:
    """Return a view of a genome as uint16 numbers: the number of items, then their genes, then zeros."""
    return genome.view(np.uint16)


@subroutine
def _are_distinct(numbers: Any, count: Any, width: Any, greatest: Any) -> Any:
    """Return whether the first genes of all items differ; the caller has checked that none is above ``greatest``."""
    known = np.zeros(greatest + 1, np.bool_)
    for place in range(1, 1 + count * width, width):
        if known[numbers[place]]:
            return False
        known[numbers[place]] = True
    return True


@subroutine
def is_sound_sequence(genome: Any, limits: Any) -> Any:
    """Return whether the number of items and each gene are within the limits, and only zeros follow the last item."""
    numbers, width = numbers_of(genome), (limits.size - 3) // 2
    count = np.int64(numbers[0])
    if count < limits[LEAST] or count > limits[MOST]:
        return False
    for place in range(1, numbers.size):
        if place > count * width:
            if numbers[place] != 0:
                return False
        else:
            gene = 2 + 2 * ((place - 1) % width)  # the place of the gene's least value in the limits
            if not limits[gene] <= numbers[place] <= limits[gene + 1]:
                return False
    return limits[-1] == 0 or _are_distinct(numbers, count, width, limits[3])  # the greatest first gene


@kernel("boolean(uint8[::1], int64[::1])")
def is_sound(genome: Genomes, limits: Cells) -> bool:
    """Call `is_sound_sequence` from Python."""
    sound: bool = is_sound_sequence(genome, limits)
    return sound


@subroutine
def clear_after(numbers: Any, count: Any, width: Any) -> Any:
    """Set the number of items, and put zeros after the last one, so that equal individuals have equal bytes."""
    numbers[0] = count
    numbers[1 + count * width :] = 0
