"""What is known of the known functions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from problems.function import checker
from problems.problem import Answer

if TYPE_CHECKING:
    from problems.function.graph import Graph
    from problems.function.problem import Function


def solve_exactly(problem: Function) -> Answer:
    """The optimum with an individual that has it, or a value that some individual has."""
    if problem.graph is not None:
        return _planted(problem.graph)
    if problem.bounds is None:
        solution = {"bits": "1" * problem.dimension, "value": 0.0}
        return Answer("optimum", 0.0, "the literature: all bits are 1", solution)
    nearest = problem.nearest_to_optimum
    value = float(checker.value(problem.name, nearest))
    solution = {"x": nearest.tolist(), "value": value}
    if problem.bits == 0:
        return Answer("optimum", value, "the literature", solution)
    # Coded numbers need not hit the optimum; another code may be better where valleys are narrower than code steps.
    return Answer(
        "optimum" if problem.name == "sphere" else "upper bound",
        value,
        "the value at the code nearest to the optimum, which is 0",
        solution,
        {"lower_bound": 0.0},
    )


def _planted(graph: Graph) -> Answer:
    parts = graph.planted.tolist()
    solution = {"parts": parts, "cut": graph.planted_cut, "planted_cut": graph.planted_cut, "value": 0.0}
    return Answer("upper bound", 0.0, "the planted partition; a better one may exist", solution)
