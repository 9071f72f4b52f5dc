"""The exact answers that arm-ik is held against: no genetic algorithm here."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput

if TYPE_CHECKING:
    from problems.arm_ik.problem import ArmIk

MOST_BITS = 15
_BATCH = 1 << 16


def enumerate_best(problem: ArmIk) -> tuple[float, NDArray[np.float64]]:
    """The least fitness of all 2^(2q) coded configurations of a two-link arm, and the first configuration that has it.

    Raises:
        BadInput: if the arm has not two links, or the codes are too many.
    """
    if len(problem.arm.links) != 2 or problem.bits > MOST_BITS:
        raise BadInput(
            f"enumeration: expected an arm of 2 links and at most {MOST_BITS} bits a joint, "
            f"found {len(problem.arm.links)} links and {problem.bits} bits"
        )
    best, best_configuration = np.inf, np.zeros(2)
    for start in range(0, 1 << 2 * problem.bits, _BATCH):
        codes = np.arange(start, min(start + _BATCH, 1 << 2 * problem.bits))
        integers = np.column_stack([codes >> problem.bits, codes & ((1 << problem.bits) - 1)])
        configurations = problem.configurations(integers)
        fitness = problem.distances(configurations)
        first = int(np.argmin(fitness))
        if fitness[first] < best or start == 0:
            best, best_configuration = float(fitness[first]), configurations[first]
    return best, best_configuration


def out_of_reach(problem: ArmIk) -> float:
    """How far the target lies outside the ring that the tip can reach, were there no obstacles and limits, m.

    A lower bound of the fitness for any number of links.
    """
    away = float(np.hypot(problem.target[0] - problem.arm.base[0], problem.target[1] - problem.arm.base[1]))
    longest = max(problem.arm.links)
    inner = max(0.0, 2 * longest - sum(problem.arm.links))
    return max(0.0, away - sum(problem.arm.links), inner - away)
