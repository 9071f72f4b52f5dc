"""What min-time is held against: the quickest path of grid nodes, by a dynamic program and by a tree search.

They share the inner problem, the time scaling of one curve, with the fitness, but nothing of the search.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.problem import Answer

if TYPE_CHECKING:
    from problems.min_time.problem import MinTime

Nodes = NDArray[np.int64]  # (nodes, 2), start and goal included, in grid steps

_LEVELS = 128


class Found(NamedTuple):
    """What a search came to.

    Attributes:
        time: of the best trajectory, s, as the fitness finds it.
        nodes: its nodes.
        inverse_dynamics: evaluations made.
        searched: the share of all paths that was searched or ruled out.
    """

    time: float
    nodes: Nodes
    inverse_dynamics: int
    searched: float = 1.0


def solve_exactly(problem: MinTime) -> Answer:
    """The answer of `dynamic_program`.

    Raises:
        BadInput: if the arm has not two joints that move.
    """
    if problem.start == problem.goal:
        return Answer("optimum", 0.0, "staying where it is")
    found = dynamic_program(problem)
    solution = problem.decode(_genome(problem, found.nodes)) if np.isfinite(found.time) else None
    return Answer(
        "upper bound",
        found.time,
        f"dynamic program over paths from neighbour to neighbour on the grid, no joint away from the goal, at full "
        f"torque, {_LEVELS} levels of speed",
        solution,
        {"inverse_dynamics": found.inverse_dynamics},
    )


def dynamic_program(problem: MinTime, longest: int = 1, levels: int = _LEVELS) -> Found:
    """The best path over (node before, node, node after, speed), timed by the fitness.

    Args:
        problem: of two joints.
        longest: move from node to node, in grid steps of each joint.
        levels: of speed at the nodes.

    Raises:
        BadInput: if the arm has not two joints that move.
    """
    from problems.min_time import oracle_kernels

    moves = [(row, column) for row in range(longest + 1) for column in range(longest + 1) if row or column]
    table, lines = _table(problem)
    # The straight line with a node on each line of the grid takes T for the distance d, at 2 d / T or less if it speeds
    # up and slows down evenly; other paths are longer, and quicker.
    straight = np.repeat(np.arange(lines)[:, None], 2, axis=1)
    distance = float(np.hypot(*np.subtract(problem.goal, problem.start)))
    fastest = 4.0 * distance / _time(problem, straight)
    _, nodes, weighed = oracle_kernels.dynamic_program(table, np.array(moves), lines, levels, fastest)
    return Found(_time(problem, nodes), nodes, weighed)


def tree_search(problem: MinTime, most: int = 1 << 62) -> Found:
    """Depth-first search with branch and bound of all paths from neighbour to neighbour (§II).

    Args:
        problem: of two joints.
        most: evaluations of the inverse dynamics after which the search ends.

    Raises:
        BadInput: if the arm has not two joints that move.
    """
    from problems.min_time import oracle_kernels

    table, lines = _table(problem)
    _, nodes, weighed, searched = oracle_kernels.tree_search(table, lines, most)
    return Found(_time(problem, nodes), nodes, weighed, searched)


def _table(problem: MinTime) -> tuple[Any, int]:
    moving = np.not_equal(problem.start, problem.goal)
    if problem.arm.size != 2 or not moving.all():
        raise BadInput(f"oracle: expected two joints that move, found {moving.sum()} of {problem.arm.size} joints")
    return problem.fitness_kernel.table, problem.grid


def _genome(problem: MinTime, nodes: Nodes) -> Any:
    from problems.min_time.coding import LEVELS

    coding, items = problem.coding, nodes[1:]
    genes = (items * coding.greatest[0] + (problem.grid - 1) // 2) // (problem.grid - 1)
    return coding.encode(np.column_stack([genes, np.full(len(items), LEVELS)]))


def _time(problem: MinTime, nodes: Nodes) -> float:
    return float(problem.evaluate(_genome(problem, nodes)[None])[0]) if len(nodes) else np.inf
