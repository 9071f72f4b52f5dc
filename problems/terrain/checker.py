"""The verification of terrain solutions by scipy and plain arithmetic along the path.

It shares no code with `evaluate`. The oracle uses this module's rules, so it is as independent of the kernels.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import pairwise
from math import dist, inf, isclose, sqrt
from typing import TYPE_CHECKING

from pydantic import ValidationError

from problems.errors import first_line
from problems.problem import Clearance, Solution, Verdict
from problems.terrain.solution import EIGHTH, STEPS, Cell, TerrainSolution

if TYPE_CHECKING:
    from problems.terrain.model import TerrainModel

TOLERANCE = 1e-6
Triangle = tuple[float, float, float]


def verify(problem: TerrainModel, solution: Solution) -> Verdict:
    """Return the path's fitness, and all that is wrong with it."""
    claimed = _parsed(solution)
    cost, blocked, astray = 0.0, 0, []
    for number, (here, there) in enumerate(pairwise(claimed.path), start=1):
        step = (there[0] - here[0], there[1] - here[1])
        if step not in STEPS:
            astray.append(f"step {number} of the path, {list(here)} to {list(there)}, leads to no neighbouring cell")
        elif (hindrance := _hindrance(problem, here, there)) is not None:
            blocked += 1
            astray.append(f"step {number} of the path, to {list(there)}, {hindrance}")
        else:
            cost += dist(here, there) * ranked(problem, difficulty(problem, there, STEPS.index(step)))
    away = dist(claimed.path[-1], problem.goal)
    objections = [*_wrong_ends(problem, claimed, away), *astray, *_wrong_claims(claimed, cost)]
    # As in §3.4, computed here a second time.
    fitness = cost if away == 0.0 and blocked == 0 else dearest(problem) * (1 + blocked) + away
    return Verdict(fitness, tuple(objections), _clearance(problem, claimed.path))


def difficulty(problem: TerrainModel, cell: Cell, heading: int) -> Triangle:
    """Return the fuzzy difficulty of a step into a passable cell by a heading."""
    found = problem.difficulties[problem.legend[problem.map[cell[0]][cell[1]]]]
    if isinstance(found, tuple):
        return found
    towards, rise = STEPS[heading], STEPS[("E", "NE", "N", "NW", "W", "SW", "S", "SE").index(found.uphill)]
    # By a cosine, where the fitness counts eighths of a turn: an independent computation.
    cosine = (towards[0] * rise[0] + towards[1] * rise[1]) / (dist(towards, (0, 0)) * dist(rise, (0, 0)))
    return found.up if cosine > 0.1 else found.down if cosine < -0.1 else found.across


def ranked(problem: TerrainModel, triangle: Triangle) -> float:
    """Return the rank of a fuzzy number.

    All three ranks are linear, so a sum of ranked steps is the rank of the fuzzy sum.
    """
    return {"optimistic": triangle[0], "pessimistic": triangle[2], "centroid": sum(triangle) / 3}[problem.rank]


def dearest(problem: TerrainModel) -> float:
    """Return K = √2·n²·(the highest difficulty on the map): no clear path that enters a cell once costs more."""
    characters = set("".join(problem.map)) & problem.legend.keys()
    found = [problem.difficulties[problem.legend[character]] for character in characters]
    triangles = [
        each for one in found for each in ([one] if isinstance(one, tuple) else [one.up, one.across, one.down])
    ]
    side = max(len(problem.map), len(problem.map[0]))
    return sqrt(2.0) * side**2 * max(ranked(problem, each) for each in triangles)


def _parsed(solution: Solution) -> TerrainSolution:
    try:
        return TerrainSolution.model_validate_json(json.dumps(solution), strict=True)
    except ValidationError as error:
        raise first_line(error, TerrainSolution, "solution") from None


def _hindrance(problem: TerrainModel, here: Cell, there: Cell) -> str | None:
    """Return why a step cannot be taken, None if it can."""
    blocked, near = problem.impassable, f"{problem.clearance:g}" if problem.clearance > 0.0 else ""

    def is_free(row: int, column: int) -> bool:
        return 0 <= row < blocked.shape[0] and 0 <= column < blocked.shape[1] and not blocked[row, column]

    if not is_free(*there):
        if not (0 <= there[0] < len(blocked) and 0 <= there[1] < len(blocked[0])):
            return "is off the map"
        return "is impassable" + (f", or nearer to such a cell than the clearance {near}" if near else "")
    is_diagonal = here[0] != there[0] and here[1] != there[1]
    if is_diagonal and not (problem.corner_cutting or (is_free(here[0], there[1]) and is_free(there[0], here[1]))):
        return "cuts a corner"
    # On the fine grid a cell's centre is at 2 row + 1, so the middle of two centres is the sum of the rows plus 1.
    middle = (here[0] + there[0] + 1, here[1] + there[1] + 1)
    if near and is_diagonal and problem.distances[middle] < problem.least_allowed:
        return f"comes nearer to an obstacle half-way than the clearance {near}"
    return None


def _clearance(problem: TerrainModel, path: list[Cell]) -> Clearance:
    """Return the least gap between the robot and an obstacle, in cells: at centres, and half-way between them.

    That is exact: a straight step is never nearer than its ends, a diagonal one never nearer than its ends and middle.
    Distances are 0 within obstacles, so a robot whose axis enters one counts as overlapping it by its radius.
    """
    least, where = inf, {}
    rows, columns = problem.distances.shape
    places = [(0, 2 * path[0][0] + 1, 2 * path[0][1] + 1)]
    for number, (here, there) in enumerate(pairwise(path), start=1):
        if (there[0] - here[0], there[1] - here[1]) in STEPS:
            places.append((number, here[0] + there[0] + 1, here[1] + there[1] + 1))
        places.append((number, 2 * there[0] + 1, 2 * there[1] + 1))
    for step, row, column in places:
        if 0 <= row < rows and 0 <= column < columns and problem.distances[row, column] < least:
            least = float(problem.distances[row, column])
            where = {"step": step, "place": [(row - 1) / 2, (column - 1) / 2]}
    return Clearance(least - problem.robot_radius, where, unit="cells")


def _wrong_ends(problem: TerrainModel, claimed: TerrainSolution, away: float) -> Iterator[str]:
    if claimed.path[0] != problem.start:
        yield f"the path starts at {list(claimed.path[0])}, not at {list(problem.start)}"
    if away > 0.0:
        yield f"the path ends {away:.3g} cells from the goal"


def _wrong_claims(claimed: TerrainSolution, cost: float) -> Iterator[str]:
    if not isclose(claimed.cost, cost, rel_tol=TOLERANCE, abs_tol=TOLERANCE):
        yield f"the path costs {cost:g}, not {claimed.cost:g}"
    row, column = claimed.path[0]
    led = [(row, column)]
    for number, (heading, cells) in enumerate(claimed.moves, start=1):
        eighths = round(heading / EIGHTH)
        if abs(heading - eighths * EIGHTH) > TOLERANCE:
            yield f"move {number} heads for {heading:g} rad, which is no multiple of π/4"
        d_row, d_column = STEPS[eighths % 8]
        # The bound keeps a move of many cells from filling the memory: more cells than the path has are wrong anyway.
        led += [(row + d_row * step, column + d_column * step) for step in range(1, min(cells, len(claimed.path)) + 1)]
        row, column = led[-1]
        if len(led) > len(claimed.path):
            break
    if led != claimed.path:
        yield "the path does not go where the moves lead"
