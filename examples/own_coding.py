"""A coding of one's own: a robot on a grid, whose individuals are moves, each one of four directions.

Run it by `supernode solve examples/own_coding.toml`.
"""

from functools import cached_property
from typing import Any

import numpy as np

import supernode
from genetics import Keys
from genetics.coding import Alphabet

STEPS = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])  # rows and columns: north, east, south, west


class Moves:
    """``count`` moves, a byte each: 0 to 3. A row's draws depend on its own cell, the seed and the generation only."""

    def __init__(self, count: int) -> None:
        self.genome_bytes = count

    @cached_property
    def alphabet(self) -> Alphabet:
        """Two bits of each byte may be set: whatever else comes over the wire is refused."""
        return Alphabet.of_bits(np.full(self.genome_bytes, 0b11, np.uint8))

    def check(self, recipe: supernode.Recipe) -> None:
        """Refuse a recipe that is not for moves."""
        if recipe.crossover != "two-point" or recipe.mutation == "one-bit":
            raise ValueError(f"moves cross by 'two-point' and mutate with a probability, found {recipe}")

    def random(self, keys: Keys, deme: int) -> np.ndarray:
        """Any moves: (rows, deme, genome_bytes)."""
        drawn = [self._draws(keys, row).integers(0, 4, (deme, self.genome_bytes)) for row in range(len(keys.cells))]
        return np.array(drawn, np.uint8)

    def recombine(self, couples: np.ndarray, recipe: supernode.Recipe, keys: Keys) -> np.ndarray:
        """Exchange a stretch, then change some moves: (rows, couples, 2, bytes) to (rows, 2 * couples, bytes)."""
        rows, count, _, size = couples.shape
        offspring = np.empty((rows, 2 * count, size), np.uint8)
        for row in range(rows):
            draws = self._draws(keys, row)
            start, end = np.sort(draws.integers(0, size + 1, (2, count, 1, 1)), axis=0)
            exchanged = (start <= np.arange(size)) & (np.arange(size) < end)
            children = np.where(exchanged, couples[row, :, ::-1], couples[row]).reshape(2 * count, size)
            changed = draws.random(children.shape) < recipe.mutation
            offspring[row] = np.where(changed, draws.integers(0, 4, children.shape), children)
        return offspring

    @staticmethod
    def _draws(keys: Keys, row: int) -> np.random.Generator:
        return np.random.default_rng([int(keys.seed), int(keys.cells[row]), keys.generation])

    def mutate_one(self, individuals: np.ndarray, keys: Keys) -> np.ndarray:
        """For the one-bit rule, which `check` refuses."""
        raise NotImplementedError

    def variation(self, recipe: supernode.Recipe) -> Any:
        """`recombine` as compiled code, for problems whose fitness is compiled."""
        raise NotImplementedError

    mutate_one_bit = variation  # likewise for `mutate_one`


class Warehouse(supernode.Problem):
    """From one corner of a floor of squares to the opposite one; # is a shelf."""

    floor: list[str]
    moves: int

    batches_alike = True

    @cached_property
    def coding(self) -> Moves:
        """The moves, one after another; one into a shelf or a wall is left out."""
        return Moves(self.moves)

    @property
    def solved_at(self) -> float:
        """There."""
        return 0.0

    def recipe(self, name: str, deme: int) -> supernode.Recipe:
        """Three moves of an individual change, on average."""
        return supernode.Recipe("two-point", min(1.0, 3 / self.moves), "elitist")

    def evaluate(self, genomes: np.ndarray) -> np.ndarray:
        """The fewest squares to the goal from anywhere on the way, if there were no shelves."""
        free = np.pad([[square != "#" for square in row] for row in self.floor], 1)
        goal = np.array(free.shape) - 2
        place = np.ones((len(genomes), 2), np.int64)
        nearest = np.full(len(genomes), np.inf)
        for move in genomes.T:
            there = place + STEPS[move]
            place = np.where(free[tuple(there.T)][:, None], there, place)
            nearest = np.minimum(nearest, np.abs(goal - place).sum(axis=1))
        return nearest
