"""Codings, crossover, mutation, selection and replacement: pure, compiled, without any input or output."""

from genetics.arrays import Cells, Fitness, Genomes
from genetics.bit_string import BitString
from genetics.breeding import breed, evaluations_per_generation
from genetics.coding import Coding, Keys
from genetics.real_vector import RealVector
from genetics.recipe import ONE_BIT, Crossover, Recipe, Replacement

__all__ = [
    "ONE_BIT",
    "BitString",
    "Cells",
    "Coding",
    "Crossover",
    "Fitness",
    "Genomes",
    "Keys",
    "RealVector",
    "Recipe",
    "Replacement",
    "breed",
    "evaluations_per_generation",
]
