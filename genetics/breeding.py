"""The one breeding rule, for a deme of one and for an island, over any number of rows of cells.

A node calls it with the single row of its own cell, the simulator with all rows at once; every draw is keyed by the
row's cell, so both get the same bits.
"""

import numpy as np

from genetics import selection
from genetics.arrays import Evaluate, Fitness, Genomes
from genetics.coding import Coding, Immigrants, Keys
from genetics.recipe import ONE_BIT, Recipe


def breed(
    genomes: Genomes,
    fitness: Fitness,
    immigrants: Immigrants | None,
    coding: Coding,
    recipe: Recipe,
    evaluate: Evaluate,
    keys: Keys,
) -> None:
    """Take ``immigrants`` in and breed the next generation, in place.

    Args:
        genomes: the demes, shape (rows, deme, genome_bytes).
        fitness: theirs, shape (rows, deme).
        immigrants: an island may get None, in a generation without exchange.
        coding: makes offspring of couples.
        recipe: the choices of the rule.
        evaluate: the problem's fitness of a batch.
        keys: what the random draws are keyed by.
    """
    if genomes.shape[1] == 1:
        assert immigrants is not None, "an individual alone has nobody to breed with"
        _breed_individual(genomes, fitness, immigrants, coding, recipe, evaluate, keys)
    else:
        if immigrants is not None:
            selection.admit(genomes, fitness, *immigrants)
        _breed_island(genomes, fitness, coding, recipe, evaluate, keys)


def _breed_individual(
    genomes: Genomes,
    fitness: Fitness,
    immigrants: Immigrants,
    coding: Coding,
    recipe: Recipe,
    evaluate: Evaluate,
    keys: Keys,
) -> None:
    """The fine-grained step (Ahuactzin et al. 1992, §6): the local individual with each of its neighbours."""
    offspring = coding.mate(genomes, immigrants, recipe, keys)
    offspring_fitness = _evaluate(evaluate, offspring)
    selection.replace_local(genomes, fitness, offspring, offspring_fitness, recipe.replacement == "elitist")


def _breed_island(
    genomes: Genomes,
    fitness: Fitness,
    coding: Coding,
    recipe: Recipe,
    evaluate: Evaluate,
    keys: Keys,
) -> None:
    """The sequential recipe (§3.1 steps 3 to 5) at constant size."""
    couples = selection.couples_by_rank(fitness, keys.seed, keys.cells, keys.generation)
    rows = np.arange(len(genomes))
    parents = genomes[rows[:, None, None], couples]
    offspring = coding.recombine(parents, recipe, keys)
    offspring_fitness = _evaluate(evaluate, offspring)
    selection.replace_families(genomes, fitness, couples, offspring, offspring_fitness, recipe.replacement == "elitist")
    if recipe.mutation == ONE_BIT:
        changed = coding.mutate_one(genomes, keys)
        fitness[rows, changed] = evaluate(genomes[rows, changed])


def _evaluate(evaluate: Evaluate, offspring: Genomes) -> Fitness:
    rows, count, size = offspring.shape
    return evaluate(offspring.reshape(rows * count, size)).reshape(rows, count)
