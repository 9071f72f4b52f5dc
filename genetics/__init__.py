"""Codings, crossover, mutation, selection and replacement: compiled pure functions, without input or output.

Importing this package loads no compiled code. Codings import their kernels at first use, so that commands which never
breed (``--help``, a client) start quickly.
"""

from genetics.arrays import Cells, Fitness, Genomes
from genetics.bit_string import BitString
from genetics.coding import Coding, Keys
from genetics.permutation import Permutation
from genetics.real_vector import RealVector
from genetics.recipe import ONE_BIT, Pairing, Recipe, Replacement, evaluations_per_generation
from genetics.sequence import Sequence

__all__ = [
    "ONE_BIT",
    "BitString",
    "Cells",
    "Coding",
    "Fitness",
    "Genomes",
    "Keys",
    "Pairing",
    "Permutation",
    "RealVector",
    "Recipe",
    "Replacement",
    "Sequence",
    "evaluations_per_generation",
]
