"""Verify points, bit strings and partitions with the formulas of the literature in plain numpy.

Nothing here is used by `evaluate`.
"""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, TypeVar

import numpy as np
from pydantic import Field, ValidationError

from problems.errors import BadInput, first_line
from problems.function.formulas import value
from problems.problem import Solution, Verdict
from problems.tables import Table

if TYPE_CHECKING:
    from problems.function.graph import Graph
    from problems.function.model import FunctionModel

Model = TypeVar("Model", bound="Claim")

_ROUNDING = 1e-9


class Claim(Table):
    """The fields that all solutions have."""

    value: float


class PointClaim(Claim):
    """The format of a solution of a function of numbers: the point, and its value."""

    x: list[float]


class BitsClaim(Claim):
    """The format of a solution of a function of bits, which are a text of 0 and 1."""

    bits: Annotated[str, Field(pattern=r"^[01]*$")]


class PartitionClaim(Claim):
    """The format of a solution of graph-partition: the part of each vertex, and the cut edges."""

    parts: list[Annotated[int, Field(ge=0)]]
    cut: int
    planted_cut: int


def verify(problem: FunctionModel, solution: Solution) -> Verdict:
    """Return the value, computed independently, and all objections.

    Raises:
        BadInput: if this is no solution of the function.
    """
    if problem.graph is not None:
        return _verify_partition(problem.graph, solution)
    if problem.bounds is None:
        return _verify_bits(problem, solution)
    claim = _parsed(PointClaim, solution, "x", problem.dimension, "numbers")
    x = np.array(claim.x)
    low, high = problem.bounds
    outside = np.flatnonzero((x < low - _ROUNDING) | (x > high + _ROUNDING))
    objections = [f"x[{number}] is {x[number]:g}, outside [{low}, {high}]" for number in outside]
    return _verdict(value(problem.name, x), claim, objections)


def _verify_bits(problem: FunctionModel, solution: Solution) -> Verdict:
    claim = _parsed(BitsClaim, solution, "bits", problem.dimension, "digits")
    if problem.name == "onemax":
        return _verdict(claim.bits.count("0"), claim, [])
    # The lengths match: `_parsed` has compared the number of bits with the dimension, a multiple of the block.
    blocks = np.array([int(bit) for bit in claim.bits]).reshape(-1, problem.block)
    ones = blocks.sum(axis=1)
    return _verdict(float(np.sum(np.where(ones == problem.block, 0, 1 + ones))), claim, [])


def _verify_partition(graph: Graph, solution: Solution) -> Verdict:
    claim = _parsed(PartitionClaim, solution, "parts", graph.vertices, "numbers")
    if max(claim.parts) >= graph.parts:
        raise BadInput(f"solution: parts: expected numbers below {graph.parts}, found {max(claim.parts)}")
    parts = np.array(claim.parts)
    cut = sum(parts[one] != parts[other] for one, other in graph.edges)
    sizes = np.bincount(parts, minlength=graph.parts)
    even = np.bincount(np.arange(graph.vertices) % graph.parts)  # the sizes of parts as equal as possible
    objections = []
    if (claim.cut, claim.planted_cut) != (cut, graph.planted_cut):
        objections.append(
            f"{cut} edges are cut and {graph.planted_cut} by the planted partition, "
            f"not {claim.cut} and {claim.planted_cut}"
        )
    return _verdict(float(cut - graph.planted_cut + sizes @ sizes - even @ even), claim, objections)


def _parsed(model: type[Model], solution: Solution, field: str, length: int, what: str) -> Model:
    try:
        claim = model.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, model, "solution") from None
    found = len(getattr(claim, field))
    if found != length:
        raise BadInput(f"solution: {field}: expected {length} {what}, found {found}")
    return claim


def _verdict(computed: float, claim: Claim, objections: list[str]) -> Verdict:
    computed = float(computed)
    if abs(computed - claim.value) > _ROUNDING * max(1.0, abs(computed)):
        objections = [*objections, f"the value is {computed:.12g}, not {claim.value:.12g}"]
    return Verdict(computed, tuple(objections))
