"""Random graphs with a planted partition: more edges within parts than between them, so a good cut is known."""

from __future__ import annotations

from functools import cached_property
from typing import Annotated, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from problems.tables import Table, quantity

Probability = Annotated[float, Field(ge=0, le=1)]
Integers = NDArray[np.int64]


class Graph(Table):
    """A graph of the planted-partition model; the same fields give the same graph."""

    vertices: int = quantity("", "the number of vertices", ge=2, le=5000)
    parts: int = quantity("", "the number of parts, of sizes as equal as possible", default=2, ge=2, le=64)
    p_in: Probability = quantity("", "probability of an edge within a part", default=0.3)
    p_out: Probability = quantity("", "probability of an edge between two parts", default=0.05)
    seed: int = quantity("", "the same seed gives the same graph", default=1, ge=0, lt=1 << 64)

    @model_validator(mode="after")
    def _a_vertex_for_each_part(self) -> Self:
        if self.parts > self.vertices:
            raise ValueError(f"parts: expected at most the {self.vertices} vertices, found {self.parts}")
        return self

    @cached_property
    def planted(self) -> Integers:
        """The part in which each vertex was planted, shape (vertices,): sizes as equal as possible, in random order."""
        # Sorting the vertices by random numbers shuffles them.
        order = np.argsort(self._generator(0).random(self.vertices), kind="stable")
        planted = np.empty(self.vertices, np.int64)
        planted[order] = np.arange(self.vertices) % self.parts
        return planted

    @cached_property
    def edges(self) -> Integers:
        """The edges as pairs of vertices, shape (edges, 2)."""
        first, second = np.triu_indices(self.vertices, k=1)
        chance = np.where(self.planted[first] == self.planted[second], self.p_in, self.p_out)
        present = self._generator(1).random(len(first)) < chance
        return np.column_stack([first[present], second[present]]).astype(np.int64)

    @cached_property
    def planted_cut(self) -> int:
        """The number of edges between the planted parts."""
        return int(np.count_nonzero(self.planted[self.edges[:, 0]] != self.planted[self.edges[:, 1]]))

    @cached_property
    def least_squares(self) -> int:
        """The least possible sum of squared part sizes, which the planted parts have."""
        return int(np.sum(np.bincount(self.planted) ** 2))

    def _generator(self, purpose: int) -> np.random.Generator:
        """Return a generator of its own for each purpose, so that neither changes the draws of the other."""
        return np.random.Generator(np.random.PCG64([self.seed, purpose]))
