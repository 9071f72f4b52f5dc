"""The yardsticks of min-time: the quickest path of grid nodes, by a dynamic program and by a tree search.

Both share the inner problem, the time scaling of one curve, with the fitness, but nothing of the search. The time
scaling itself is tested against closed forms, pinocchio and TOPP-RA.

Neither gives a lower bound. Both know only moves between neighbours that never lead away from the goal, and the dynamic
program only some levels of speed. A trajectory with fewer nodes, or with nodes off the grid, may be quicker.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.problem import Answer

if TYPE_CHECKING:
    from problems.min_time.model import MinTimeModel

Nodes = NDArray[np.int64]  # (nodes, 2), start and goal included, in grid steps

_LEVELS = 128  # levels of speed at the nodes


class Found(NamedTuple):
    """The result of a search.

    Attributes:
        time: The time of the best trajectory, s, as the fitness finds it; inf if no trajectory was found.
        nodes: The nodes of the best trajectory.
        inverse_dynamics: The number of evaluations of the inverse dynamics.
        searched: The share of all paths that was searched or ruled out.
    """

    time: float
    nodes: Nodes
    inverse_dynamics: int
    searched: float = 1.0


def solve_exactly(problem: MinTimeModel) -> Answer:
    """Return the best trajectory of `dynamic_program`, as an upper bound of the least time.

    Raises:
        BadInput: If the arm does not have exactly two joints, both of which move.
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


def dynamic_program(problem: MinTimeModel, longest: int = 1, levels: int = _LEVELS) -> Found:
    """Return the best path by a dynamic program over (node before, node, node after, speed), timed by the fitness.

    The program's own time is not returned: it allows only some levels of speed at the nodes, and does not look between
    grid points. So the fitness times its path again.

    Args:
        problem: A problem with two joints.
        longest: The longest move from node to node, in grid steps of each joint.
        levels: The number of levels of speed at the nodes.

    Raises:
        BadInput: If the arm does not have exactly two joints, both of which move.
    """
    from problems.min_time import oracle_kernels

    moves = [(row, column) for row in range(longest + 1) for column in range(longest + 1) if row or column]
    table, lines = _table(problem)
    # The range of speeds comes from the straight line with a node on each line of the grid. Over the distance d in time
    # T its greatest speed is 2 d / T if it speeds up and slows down evenly. Others are longer and quicker, so twice
    # that is allowed.
    straight = np.repeat(np.arange(lines)[:, None], 2, axis=1)
    distance = float(np.hypot(*np.subtract(problem.goal, problem.start)))
    fastest = 4.0 * distance / _time(problem, straight)
    _, nodes, weighed = oracle_kernels.dynamic_program(table, np.array(moves), lines, levels, fastest)
    return Found(_time(problem, nodes), nodes, weighed)


def tree_search(problem: MinTimeModel, most: int = 1 << 62) -> Found:
    """Search all paths from neighbour to neighbour depth first, with branch and bound (§II).

    Args:
        problem: A problem with two joints.
        most: The number of evaluations of the inverse dynamics after which the search ends.

    Raises:
        BadInput: If the arm does not have exactly two joints, both of which move.
    """
    from problems.min_time import oracle_kernels

    table, lines = _table(problem)
    _, nodes, weighed, searched = oracle_kernels.tree_search(table, lines, most)
    return Found(_time(problem, nodes), nodes, weighed, searched)


def _table(problem: MinTimeModel) -> tuple[Any, int]:
    moving = np.not_equal(problem.start, problem.goal)
    if problem.arm.size != 2 or not moving.all():
        raise BadInput(f"oracle: expected two joints that move, found {moving.sum()} of {problem.arm.size} joints")
    return problem.fitness_kernel.table, problem.grid


def _genome(problem: MinTimeModel, nodes: Nodes) -> Any:
    from problems.min_time.levels import LEVELS

    coding, items = problem.coding, nodes[1:]
    # The gene nearest to the grid line, as the coding's kernels round it; both joints have the same range of genes.
    genes = (items * coding.greatest[0] + (problem.grid - 1) // 2) // (problem.grid - 1)
    return coding.encode(np.column_stack([genes, np.full(len(items), LEVELS)]))


def _time(problem: MinTimeModel, nodes: Nodes) -> float:
    return float(problem.evaluate(_genome(problem, nodes)[None])[0]) if len(nodes) else np.inf
