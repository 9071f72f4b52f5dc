"""The yardsticks of min-time: the quickest path of grid nodes, by a dynamic program and by a tree search.

Both search with the compiled time scaling of a stretch, which the fitness uses too. So no time of theirs is believed:
the answer is a trajectory, and its time is what the checker finds, which shares no code with the fitness.

Neither gives a lower bound. Both know only moves between neighbours that never lead away from the goal, and the dynamic
program only some levels of speed. A trajectory with fewer nodes, or with nodes off the grid, may be quicker.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from problems.errors import BadInput
from problems.min_time import checker
from problems.problem import Answer, Solution

if TYPE_CHECKING:
    from problems.min_time.model import MinTimeModel

Nodes = NDArray[np.int64]  # (nodes, 2), start and goal included, in grid steps

_LEVELS = 128  # levels of speed at the nodes


class Found(NamedTuple):
    """The result of a search.

    Attributes:
        time: The time of the best trajectory, s, as the checker finds it; inf if no trajectory was found.
        nodes: The nodes of the best trajectory.
        solution: The best trajectory, in the format of `MinTime.decode`; None if none was found.
        inverse_dynamics: The number of evaluations of the inverse dynamics.
        searched: The share of all paths that was searched or ruled out.
    """

    time: float
    nodes: Nodes
    solution: Solution | None
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
    return Answer(
        "upper bound",
        found.time,
        f"dynamic program over paths from neighbour to neighbour on the grid, no joint away from the goal, at full "
        f"torque, {_LEVELS} levels of speed",
        found.solution,
        {"inverse_dynamics": found.inverse_dynamics},
    )


def dynamic_program(problem: MinTimeModel, longest: int = 1, levels: int = _LEVELS) -> Found:
    """Return the best path by a dynamic program over (node before, node, node after, speed).

    The program's own time is not returned: it allows only some levels of speed at the nodes, and does not look between
    grid points.

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
    fastest = 4.0 * distance / _timed(problem, straight)[0]
    _, nodes, weighed = oracle_kernels.dynamic_program(table, np.array(moves), lines, levels, fastest)
    time, solution = _timed(problem, nodes)
    return Found(time, nodes, solution, weighed)


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
    time, solution = _timed(problem, nodes)
    return Found(time, nodes, solution, weighed, searched)


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


def _timed(problem: MinTimeModel, nodes: Nodes) -> tuple[float, Solution | None]:
    """Return the time of a path's trajectory, s, as the checker finds it, and the trajectory.

    Return inf and None if there is no path, or if the checker objects to the trajectory.
    """
    if len(nodes) == 0:
        return np.inf, None
    solution = problem.decode(_genome(problem, nodes))
    verdict = checker.verify(problem, solution)
    return (verdict.fitness, solution) if verdict.feasible else (np.inf, None)
