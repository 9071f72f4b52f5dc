"""The known optima of the functions, or values close to them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.function import formulas
from problems.problem import Answer

if TYPE_CHECKING:
    from problems.function.graph import Graph
    from problems.function.model import FunctionModel


def solve_exactly(problem: FunctionModel) -> Answer:
    """Return the optimum with a solution that attains it; where it is not known, an upper bound with a solution."""
    if problem.graph is not None:
        return _planted(problem.graph)
    if problem.bounds is None:
        solution = {"bits": "1" * problem.dimension, "value": 0.0}
        return Answer("optimum", 0.0, "the literature: all bits are 1", solution)
    nearest = problem.nearest_to_optimum
    value = float(formulas.value(problem.name, nearest))
    solution = {"x": nearest.tolist(), "value": value}
    if problem.bits == 0:
        return Answer("optimum", value, "the literature", solution)
    # The optimum need not have a code. The code nearest to it is the best one for sphere; elsewhere another code may be
    # better, if valleys are narrower than a code step.
    return Answer(
        "optimum" if problem.name == "sphere" else "upper bound",
        value,
        "the value at the code nearest to the optimum, which is 0",
        solution,
        {"lower_bound": 0.0},
    )


def _planted(graph: Graph) -> Answer:
    """Return the planted partition, an upper bound."""
    parts = graph.planted.tolist()
    solution = {"parts": parts, "cut": graph.planted_cut, "planted_cut": graph.planted_cut, "value": 0.0}
    return Answer("upper bound", 0.0, "the planted partition; a better one may exist", solution)
