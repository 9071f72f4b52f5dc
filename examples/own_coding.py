"""A user-defined coding: a robot on a grid, whose individuals are lists of moves in four directions.

Run it with `supernode solve examples/own_coding.toml`.
"""

from functools import cached_property
from typing import Any

import numpy as np

import supernode
from genetics import Keys
from genetics.coding import Alphabet

STEPS = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])  # rows and columns: north, east, south, west


class Moves:
    """A coding of ``count`` moves, one byte each, 0 to 3.

    The random draws of a row depend on its own cell, the seed and the generation only.
    """

    def __init__(self, count: int) -> None:
        self.genome_bytes = count

    @cached_property
    def alphabet(self) -> Alphabet:
        """Return the valid genomes: two bits of each byte may be set. Other genomes in messages are refused."""
        return Alphabet.of_bits(np.full(self.genome_bytes, 0b11, np.uint8))

    def check(self, recipe: supernode.Recipe) -> None:
        """Raise ValueError if the recipe is not for moves."""
        if recipe.crossover != "two-point" or recipe.mutation == "one-bit":
            raise ValueError(f"moves cross by 'two-point' and mutate with a probability, found {recipe}")

    def random(self, keys: Keys, deme: int) -> np.ndarray:
        """Return random moves, (rows, deme, genome_bytes)."""
        drawn = [self._draws(keys, row).integers(0, 4, (deme, self.genome_bytes)) for row in range(len(keys.cells))]
        return np.array(drawn, np.uint8)

    def recombine(self, couples: np.ndarray, recipe: supernode.Recipe, keys: Keys) -> np.ndarray:
        """Exchange a stretch of moves, then mutate: (rows, couples, 2, bytes) to (rows, 2 * couples, bytes)."""
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
        """Not used: the one-bit mutation needs it, and `check` refuses that."""
        raise NotImplementedError

    def variation(self, recipe: supernode.Recipe) -> Any:
        """Not used: only problems with a compiled fitness need `recombine` as compiled code."""
        raise NotImplementedError

    mutate_one_bit = variation  # not used either, for the same reason


class Warehouse(supernode.Problem):
    """A robot moves from one corner of a floor of squares to the opposite corner; # is a shelf."""

    floor: list[str]
    moves: int

    is_batch_invariant = True

    @cached_property
    def coding(self) -> Moves:
        """Return the coding: a list of moves. `evaluate` skips a move into a shelf or a wall."""
        return Moves(self.moves)

    @property
    def solved_at(self) -> float:
        """Return the fitness that counts as solved: the robot has reached the goal."""
        return 0.0

    def recipe(self, name: str, deme: int) -> supernode.Recipe:
        """Use a mutation that changes three moves of an individual on average."""
        return supernode.Recipe("two-point", min(1.0, 3 / self.moves), "elitist")

    def evaluate(self, genomes: np.ndarray) -> np.ndarray:
        """Return the least distance to the goal along the way, in squares, as if there were no shelves.

        The input is (n, genome_bytes), the result (n,).
        """
        # A border of blocked squares saves a test for the edge of the floor.
        free = np.pad([[square != "#" for square in row] for row in self.floor], 1)
        goal = np.array(free.shape) - 2
        place = np.ones((len(genomes), 2), np.int64)
        nearest = np.full(len(genomes), np.inf)
        for move in genomes.T:
            there = place + STEPS[move]
            place = np.where(free[tuple(there.T)][:, None], there, place)
            nearest = np.minimum(nearest, np.abs(goal - place).sum(axis=1))
        return nearest
