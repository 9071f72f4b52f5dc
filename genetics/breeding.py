"""The breeding rule, for a deme of one and for an island, over any number of rows of cells.

The simulator calls it with all rows at once. A node breeds its only row by `node.engine.rule`, which has the same rule
for one row, made of the same compiled parts. Every draw is keyed by the row's cell, so both get the same bits.

Many rows are bred in blocks. The temporary arrays of a generation, the offspring and what an evaluation makes of them,
then fit into the processor's cache, and for a million cells into memory.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from genetics import replacement, selection
from genetics.arrays import Cells, Evaluate, Fitness, Genomes
from genetics.coding import Coding, Immigrants, Keys
from genetics.recipe import ONE_BIT, Recipe

Evaluators = Evaluate | Sequence[Evaluate]
"""One function that evaluates all rows together, or one for each row, as a node evaluates its own."""

_TOGETHER = 1 << 13  # individuals in a block


def breed(
    genomes: Genomes,
    fitness: Fitness,
    immigrants: Immigrants | None,
    coding: Coding,
    recipe: Recipe,
    evaluate: Evaluators,
    keys: Keys,
) -> None:
    """Admit ``immigrants`` and breed the next generation, in place.

    Args:
        genomes: the demes, shape (rows, deme, genome_bytes).
        fitness: the demes' fitness, shape (rows, deme).
        immigrants: for an island None in a generation without exchange; a deme of one always needs some.
        coding: makes offspring of couples.
        recipe: the choices of the rule.
        evaluate: evaluates a batch of genomes. There must be one for each row if the result may depend on the other
            individuals of a batch, if only in the last bit, or if evaluating leaves a state.
        keys: the coordinates of the random draws.
    """
    alone = genomes.shape[1] == 1
    assert immigrants is not None or not alone, "an individual alone has nobody to breed with"
    if immigrants is not None and not alone:
        # Not block by block: `admit` recognises a slot that names the row itself by the row's index among all.
        replacement.admit(genomes, fitness, *immigrants, *_drawn_by(keys))
    for block in _blocks(genomes):
        part, evaluators = (genomes[block], fitness[block]), _evaluators_of(evaluate, block)
        its_keys = keys._replace(cells=keys.cells[block])
        if alone:
            assert immigrants is not None
            its_immigrants = immigrants._replace(source_row=immigrants.source_row[block])
            _breed_individual(*part, its_immigrants, coding, recipe, evaluators, its_keys)
        else:
            _breed_island(*part, coding, recipe, evaluators, its_keys)


def evaluate_all(genomes: Genomes, evaluate: Evaluators) -> Fitness:
    """Return the fitness of whole demes, (rows, deme, genome_bytes) to (rows, deme), in the same blocks as `breed`."""
    return np.concatenate([_evaluate(_evaluators_of(evaluate, block), genomes[block]) for block in _blocks(genomes)])


def _blocks(genomes: Genomes) -> Iterator[slice]:
    """Divide the rows into blocks of about `_TOGETHER` individuals, at least one row each."""
    rows, deme, _ = genomes.shape
    each = max(1, _TOGETHER // deme)
    return (slice(first, first + each) for first in range(0, rows, each))


def _evaluators_of(evaluate: Evaluators, block: slice) -> Evaluators:
    return evaluate if callable(evaluate) else evaluate[block]


def _breed_individual(
    genomes: Genomes,
    fitness: Fitness,
    immigrants: Immigrants,
    coding: Coding,
    recipe: Recipe,
    evaluate: Evaluators,
    keys: Keys,
) -> None:
    """Breed demes of one: the fine-grained step (Ahuactzin et al. 1992, §6), the individual with each neighbour's."""
    couples = selection.couples_with(genomes, immigrants.genomes, immigrants.source_row, immigrants.each)
    offspring = coding.recombine(couples, recipe, keys)
    if recipe.mutation == ONE_BIT:
        coding.mutate_one(offspring, keys)
    offspring_fitness = _evaluate(evaluate, offspring)
    elitist = recipe.replacement == "elitist"
    replacement.replace_local(genomes, fitness, offspring, offspring_fitness, elitist, *_drawn_by(keys))


def _breed_island(
    genomes: Genomes,
    fitness: Fitness,
    coding: Coding,
    recipe: Recipe,
    evaluate: Evaluators,
    keys: Keys,
) -> None:
    """Breed islands by a sequential recipe at constant size, such as that of §3.1 steps 3 to 5."""
    couples = selection.pairs(
        fitness,
        keys.seed,
        keys.cells,
        keys.generation,
        recipe.couples(fitness.shape[1]),
        recipe.pairing == "better-half",
        recipe.most_selections,
    )
    rows = np.arange(len(genomes))
    parents = genomes[rows[:, None, None], couples]
    offspring = coding.recombine(parents, recipe, keys)
    offspring_fitness = _evaluate(evaluate, offspring)
    elitist = recipe.replacement == "elitist"
    if recipe.renewal is None:
        replacement.replace_families(genomes, fitness, couples, offspring, offspring_fitness, elitist, *_drawn_by(keys))
    else:
        replacement.replace_worst(genomes, fitness, offspring, offspring_fitness, elitist, *_drawn_by(keys))
    if recipe.mutation == ONE_BIT:
        changed = coding.mutate_one(genomes, keys)
        fitness[rows, changed] = _evaluate(evaluate, genomes[rows, changed, None])[:, 0]


def _drawn_by(keys: Keys) -> tuple[np.uint64, Cells, int]:
    """Return the keys in the order in which kernels take them."""
    return keys.seed, keys.cells, keys.generation


def _evaluate(evaluate: Evaluators, individuals: Genomes) -> Fitness:
    """Evaluate each row's individuals: (rows, count, genome_bytes) to (rows, count)."""
    rows, count, size = individuals.shape
    if callable(evaluate):
        return evaluate(individuals.reshape(rows * count, size)).reshape(rows, count)
    return np.stack([its_own(each) for its_own, each in zip(evaluate, individuals, strict=True)])
