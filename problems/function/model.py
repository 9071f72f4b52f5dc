"""The model of function: benchmark functions of numbers, bits and graphs, whose optimum is known."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import model_validator

from genetics.arrays import Fitness, Genomes, writable
from genetics.recipe import Recipe
from lowlevel import capabilities
from problems.function import formulas
from problems.function.graph import Graph
from problems.problem import CodedProblem, Solution
from problems.tables import RecipeName, quantity

if TYPE_CHECKING:
    from genetics.bit_string import BitString
    from genetics.operators import Operator
    from genetics.real_vector import RealVector

Name = Literal["rastrigin", "sphere", "ackley", "rosenbrock", "onemax", "trap", "graph-partition"]

_BOUNDS = {  # of each parameter; the optimum is 0, at x = 0 or, for rosenbrock, at x = 1
    "rastrigin": (-5.12, 5.12),
    "sphere": (-5.12, 5.12),
    "ackley": (-32.768, 32.768),
    "rosenbrock": (-2.048, 2.048),
}
_REAL_TARGET = 1e-2  # the fitness that solves a function of real numbers
_ROUNDING = 1e-9
_TRAP = 5  # bits in a block of the trap function
_FLIPS = 2.4  # mean number of bits that mutation flips per offspring (tuned)


class FunctionModel(CodedProblem):
    """The fields, coding, recipe, fitness and decoding; `Function` adds what verifies and shows solutions."""

    about: ClassVar[str] = "known functions: for tests, comparisons and load"
    template: ClassVar[str] = """\
kind = "function"
name = "rastrigin"      # or sphere, ackley, rosenbrock, onemax, trap, graph-partition
dimension = 10          # parameters, or bits of onemax and trap; graph-partition has its vertices instead
bits = 0                # of each parameter; 0: real numbers
# code = "gray"         # or "binary"; if not given, the recipe's
# cost_us = 500         # microseconds of processor time added to each evaluation

# [graph]               # for graph-partition
# vertices = 64
# parts = 2
# p_in = 0.3            # probability of an edge within a part
# p_out = 0.05          # and between two parts
# seed = 1

[run]                   # what the command line does not say
topology = "torus 4x4"
seed = 1
"""
    oracle_decides: ClassVar[bool] = False  # the oracle's value may be only that of a code near the optimum
    is_batch_invariant: ClassVar[bool] = True
    any_thread: ClassVar[bool] = True

    name: Name = quantity("", "the function")
    dimension: int = quantity(
        "", "parameters, or bits of onemax and trap; not for graph-partition", default=10, ge=1, le=10_000
    )
    bits: int = quantity("bit", "bits of each parameter; 0 for real numbers", default=0, ge=0, le=62)
    cost_us: float = quantity("µs", "thread processor time added to each evaluation", default=0, ge=0, le=1e7)
    graph: Graph | None = quantity("", "for graph-partition: the graph", default=None)

    @model_validator(mode="after")
    def _fields_are_those_of_the_function(self) -> Self:
        complaint = self._graph_complaint() or self._size_complaint()
        if complaint is not None:
            raise ValueError(complaint)
        return self

    def _graph_complaint(self) -> str | None:
        if (self.name == "graph-partition") == (self.graph is None):
            found = "nothing" if self.graph is None else "one"
            return f"graph: expected a table [graph] for graph-partition only, found {found} for {self.name}"
        return None

    def _size_complaint(self) -> str | None:
        if self.graph is not None and "dimension" in self.model_fields_set:
            return f"dimension: expected none, as the graph has its vertices, found {self.dimension}"
        if self.bounds is None and self.bits:
            return f"bits: expected none, as the parameters of {self.name} are not numbers, found {self.bits}"
        if self.name == "trap" and self.dimension % self.block:
            return f"dimension: expected a multiple of {self.block}, the bits of a trap, found {self.dimension}"
        if self.name == "rosenbrock" and self.dimension < 2:
            return f"dimension: expected at least 2 for rosenbrock, found {self.dimension}"
        return None

    @property
    def bounds(self) -> tuple[float, float] | None:
        """The bounds of each parameter; None if the parameters are not numbers."""
        return _BOUNDS.get(self.name)

    @property
    def block(self) -> int:
        """The number of bits in a block of the trap function."""
        return _TRAP

    @cached_property
    def coding(self) -> BitString | RealVector:
        """Real numbers, bit-coded numbers, single bits, or the part of each vertex."""
        from genetics.bit_string import BitString
        from genetics.real_vector import RealVector

        if self.graph is not None:
            return BitString(self.graph.vertices, (self.graph.parts - 1).bit_length())
        if self.bounds is None:
            return BitString(self.dimension, 1)
        if self.bits == 0:
            return RealVector(self.dimension, *self.bounds)
        return BitString(self.dimension, self.bits, gray=self.code != "binary")

    @cached_property
    def solved_at(self) -> float:
        """0 for bits and graphs, 0.01 for real numbers; for coded numbers the value at the code nearest to the optimum.

        The optimum itself need not have a code: the odd number 2^q − 1 of steps has no middle, so none falls on 0.
        """
        if self.bounds is None:
            return 0.0
        if self.bits == 0:
            return _REAL_TARGET
        return float(formulas.value(self.name, self.nearest_to_optimum)) + _ROUNDING

    @property
    def nearest_to_optimum(self) -> NDArray[np.float64]:
        """For a function of numbers, the coded point nearest to the optimum, shape (dimension,)."""
        assert self.bounds is not None, "a point is of numbers"
        low, high = self.bounds
        best = 1.0 if self.name == "rosenbrock" else 0.0
        if self.bits > 0:
            steps = (1 << self.bits) - 1
            best = low + (high - low) * round((best - low) / (high - low) * steps) / steps
        return np.full(self.dimension, best)

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return the operators; tuned bit strings have uniform crossover and more mutation than the default.

        The trap keeps one-point crossover, since uniform crossover would destroy its blocks.
        """
        if name == "paper" or (self.bounds is not None and self.bits == 0):
            return super().recipe(name, deme)
        crossover: Literal["one-point", "uniform"] = "one-point" if self.name == "trap" else "uniform"
        return Recipe(crossover, min(0.5, _FLIPS / self._bit_string.length), "elitist")

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return the function's values: (n, genome_bytes) to (n,), after ``cost_us`` of processor time for each."""
        if self.cost_us > 0:
            from problems.function.kernels import spend

            spend(self._cost_ns * len(genomes))
        return self._compiled.fitness(genomes)

    @property
    def fitness_kernel(self) -> Operator:
        """`evaluate` as compiled code, for every combination of fields."""
        return self._costly

    @property
    def _cost_ns(self) -> int:
        return round(1000 * self.cost_us)

    @cached_property
    def _costly(self) -> Operator:
        """The compiled function, made slower if ``cost_us`` asks for it, where kernels may call each other."""
        from genetics.operators import Operator

        function = self._compiled
        if self.cost_us == 0 or not capabilities().numba_calls:
            return function
        from problems.function import costly_kernels

        costly = Operator.of(costly_kernels.costly, [function.address, self._cost_ns], function.table)
        # The inner function's table holds addresses of its arrays, so these must live as long as the outer operator.
        return costly._replace(kept=(*costly.kept, *function.kept))

    @cached_property
    def _compiled(self) -> Operator:
        """The compiled function without extra cost; `problems.function.kernels` describes its table."""
        from genetics.operators import Operator
        from problems.function import kernels

        if self.bounds is not None:
            layout = [self.bits, self.code != "binary", self.dimension]
            return Operator.of(getattr(kernels, self.name), layout, [float(bound) for bound in self.bounds])
        bits = self._bit_string
        layout = [bits.bits, False, bits.parameters]
        if self.graph is not None:
            offset = self.graph.planted_cut + self.graph.least_squares
            return Operator.of(kernels.partition, layout, [self.graph.parts, offset], self.graph.edges.reshape(-1, 2))
        if self.name == "onemax":
            return Operator.of(kernels.onemax, layout)
        return Operator.of(kernels.trap, layout, self.block)

    def points(self, genomes: Genomes) -> NDArray[np.float64]:
        """Return the numbers that genomes code: (n, genome_bytes) to (n, dimension).

        Raises:
            TypeError: if the parameters are not numbers.
        """
        if self.bounds is None:
            raise TypeError(f"the parameters of {self.name} are not numbers")
        if self.bits == 0:
            return writable(genomes).view(np.float64)
        low, high = self.bounds
        return low + (high - low) * self._bit_string.integers(genomes) / ((1 << self.bits) - 1)

    @property
    def _bit_string(self) -> BitString:
        from genetics.bit_string import BitString

        assert isinstance(self.coding, BitString), "real numbers have no bits"
        return self.coding

    def decode(self, genome: Genomes) -> Solution:
        """Return ``{"value": f}`` with a field for the kind of function.

        The field is ``"x": [..]``, ``"bits": "01.."``, or ``"parts": [..]`` beside ``"cut"`` and ``"planted_cut"``.
        """
        value = float(self._compiled.fitness(genome[None])[0])
        if self.bounds is not None:
            return {"x": self.points(genome[None])[0].tolist(), "value": value}
        integers = self._bit_string.integers(genome[None])[0]
        if self.graph is None:
            return {"bits": "".join(map(str, integers)), "value": value}
        parts = integers % self.graph.parts
        cut = int(np.count_nonzero(parts[self.graph.edges[:, 0]] != parts[self.graph.edges[:, 1]]))
        return {"parts": parts.tolist(), "cut": cut, "planted_cut": self.graph.planted_cut, "value": value}

    def describe(self, solution: Solution) -> str:
        """Return the numbers to six digits, or the bits or parts as they are."""
        if "x" in solution:
            return "x = " + ", ".join(f"{x:.6g}" for x in solution["x"])
        return super().describe(solution)
