"""Random floors for mobile robots, and a program that solves them.

The same number gives the same floor. docs/mobile-robot.md says which floors were used for development.

Usage: python -m benchmarks.robot_worlds --floors three-rooms --seeds 100 [--first 1] [--simulate]

The program solves each floor by the defaults on a torus of 4 × 4: on processes that are already up, one job after the
other, or in this process (--simulate), which measures no seconds. The number of a floor is also the seed. *Seconds* are
from submitting a job to its checked result. *Length* is relative to the oracle's lower bound.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy import ndimage

import supernode
from problems import ProblemFile, Run
from problems.mobile_robot import MobileRobot
from problems.plane import Circle
from spy.result import Result

Fields = dict[str, Any]

WALL = 0.15  # m, the thickness
CELL = 0.05  # m, the cell size of the grid that proves solvability
MOST_TRIES = 1000

_FORKLIFT: Fields = {"vertices": [[-0.425, -0.3], [0.425, -0.3], [0.425, 0.3], [-0.425, 0.3]]}


def robot_world(number: int, run: Run | None = None) -> ProblemFile:
    """Return world ``number``: rooms with doors if it is even, else clutter. Half of the robots are discs.

    The goal is not visible from the start, and a disc around the robot certainly can reach it.
    """
    generator = np.random.default_rng([1992, 5, number])
    for _ in range(MOST_TRIES):
        fields = _world(generator, number)
        try:
            problem = MobileRobot.model_validate(fields)
        except ValueError:  # the start or the goal is not free
            continue
        if is_surely_solvable(problem) and not _is_trivial(problem):
            return ProblemFile(f"world {number}", fields, run or Run(), Path())
    raise RuntimeError(f"no solvable world {number} in {MOST_TRIES} tries")


def three_room_world(number: int, run: Run | None = None) -> ProblemFile:
    """Return a floor of three rooms in a row, one door in each wall, 20 obstacles, and a robot of 0.85 m by 0.6 m.

    Doors are 0.95 m to 1.3 m wide. The robot goes from the first room to the last. The oracle proves a way.
    """
    generator = np.random.default_rng([1992, 30, number])
    return _proven(f"three rooms {number}", lambda: _three_rooms(generator, _FORKLIFT, (0.95, 1.3)), run)


def narrow_door_world(number: int, run: Run | None = None) -> ProblemFile:
    """Return a floor of three rooms whose doors are 5 % to 20 % wider than the robot.

    Even worlds have a polygon, odd ones a disc. The oracle proves a way.
    """
    generator = np.random.default_rng([1992, 31, number])

    def fields() -> Fields:
        robot = _robot(generator, is_disc=number % 2 == 1)
        width = _width(robot)
        return _three_rooms(generator, robot, (1.05 * width, 1.2 * width))

    return _proven(f"narrow doors {number}", fields, run)


def _proven(name: str, draw: Callable[[], Fields], run: Run | None) -> ProblemFile:
    """Draw floors until the oracle proves a way on one, and return it."""
    for _ in range(MOST_TRIES):
        fields = draw()
        try:
            problem = MobileRobot.model_validate(fields)
        except ValueError:  # the start or the goal is not free
            continue
        if problem.oracle().meaning == "optimum":
            return ProblemFile(name, fields, run or Run(), Path())
    raise RuntimeError(f"{name}: no floor with a way in {MOST_TRIES} tries")


def _three_rooms(generator: np.random.Generator, robot: Fields, doors: tuple[float, float]) -> Fields:
    width, height = (round(float(side), 2) for side in generator.uniform([12.0, 7.0], [18.0, 10.0]))
    walls = [(number + generator.uniform(0.85, 1.15)) * width / 3 for number in range(2)]
    obstacles = [part for at in walls for part in _wall_with_door(generator, at, height, generator.uniform(*doors))]
    obstacles += [_small_thing(generator, width, height) for _ in range(20)]
    low, high = [0.0, 0.0, -np.pi], [walls[0], height, np.pi]
    start, goal = generator.uniform(low, high), generator.uniform([walls[1], *low[1:]], [width, *high[1:]])
    return {
        "kind": "mobile-robot",
        "start": start.tolist(),
        "goal": goal.tolist(),
        "bounds": [0.0, 0.0, width, height],
        "robot": robot,
        "obstacles": obstacles,
    }


def _wall_with_door(generator: np.random.Generator, at: float, height: float, door: float) -> list[Fields]:
    begin = float(generator.uniform(WALL, height - WALL - door))
    return [_box([at, (a + b) / 2], [WALL, b - a]) for a, b in ((0.0, begin), (begin + door, height))]


def _small_thing(generator: np.random.Generator, width: float, height: float) -> Fields:
    """Return an obstacle of the size of a piece of furniture."""
    center = generator.uniform([0.0, 0.0], [width, height]).tolist()
    if generator.integers(2):
        return {"shape": "circle", "center": center, "radius": float(generator.uniform(0.15, 0.5))}
    return _box(center, generator.uniform(0.3, 1.5, 2).tolist(), float(generator.uniform(0.0, np.pi)))


def _width(robot: Fields) -> float:
    """Return the width of a robot across its heading, m."""
    if "radius" in robot:
        return 2.0 * float(robot["radius"])
    return float(np.ptp([y for _, y in robot["vertices"]]))


def _is_trivial(problem: MobileRobot) -> bool:
    coding = problem.coding
    standing_still = coding.encode(np.zeros((1, coding.parameters), np.int64))
    path = problem.decode(standing_still[0])["path"]
    return len(path) <= 4 and bool(problem.evaluate(standing_still)[0] == 0.0)


def is_surely_solvable(problem: MobileRobot) -> bool:
    """Return whether a disc that encloses the robot and its way through a grid cell can reach the goal."""
    free = _free_cells(problem)
    regions, _ = ndimage.label(free)
    start, goal = (_cell(problem, pose) for pose in (problem.start, problem.goal))
    return bool(free[start] and regions[start] == regions[goal])


def _cell(problem: MobileRobot, pose: tuple[float, float, float]) -> tuple[int, int]:
    return int((pose[0] - problem.bounds[0]) / CELL), int((pose[1] - problem.bounds[1]) / CELL)


def _free_cells(problem: MobileRobot) -> NDArray[np.bool_]:
    """Return the cells in which an enclosing disc is free everywhere, (columns, rows)."""
    x0, y0, x1, y1 = problem.bounds
    needed = (problem.robot.radius or problem.robot.circumscribed_radius) + CELL
    columns, rows = np.arange(x0 + CELL / 2, x1 + CELL, CELL), np.arange(y0 + CELL / 2, y1 + CELL, CELL)
    x, y = np.meshgrid(columns, rows, indexing="ij")
    solids = [
        shapely.Point(each.center).buffer(each.radius) if isinstance(each, Circle) else each.polygon
        for each in problem.obstacles
    ]
    everything = shapely.union_all(solids)
    shapely.prepare(everything)
    walls = np.minimum(np.minimum(x - x0, x1 - x), np.minimum(y - y0, y1 - y))
    free: NDArray[np.bool_] = (walls >= needed) & ~shapely.dwithin(everything, shapely.points(x, y), needed)
    return free


def _world(generator: np.random.Generator, number: int) -> Fields:
    width, height = (round(float(side), 2) for side in generator.uniform([10.0, 8.0], [18.0, 14.0]))
    obstacles = _rooms(generator, width, height) if number % 2 == 0 else _clutter(generator, width, height)
    poses = generator.uniform([0.0, 0.0, -np.pi], [width, height, np.pi], (2, 3))
    return {
        "kind": "mobile-robot",
        "start": poses[0].tolist(),
        "goal": poses[1].tolist(),
        "bounds": [0.0, 0.0, width, height],
        "robot": _robot(generator, is_disc=number % 4 >= 2),
        "obstacles": obstacles,
    }


def _robot(generator: np.random.Generator, is_disc: bool) -> Fields:
    size = float(generator.uniform(0.2, 0.4))
    if is_disc:
        return {"radius": size}
    long, wide = size * generator.uniform([0.9, 0.5], [1.2, 0.9])
    front = wide * generator.uniform(0.3, 1.0)
    return {"vertices": [[-long, -wide], [long, -front], [long, front], [-long, wide]]}


def _rooms(generator: np.random.Generator, width: float, height: float) -> list[Fields]:
    """Return the walls of rooms, by repeated halving of the largest room; each new wall has a door."""
    rooms = [(0.0, 0.0, width, height)]
    obstacles: list[Fields] = []
    for _ in range(generator.integers(3, 8)):
        rooms.sort(key=lambda room: (room[2] - room[0]) * (room[3] - room[1]))
        x0, y0, x1, y1 = rooms.pop()
        upright = x1 - x0 > y1 - y0
        low, high, near, far = (x0, x1, y0, y1) if upright else (y0, y1, x0, x1)
        at = float(generator.uniform(low + 0.35 * (high - low), high - 0.35 * (high - low)))
        door = float(generator.uniform(1.0, 1.5))
        begin = float(generator.uniform(near + WALL, far - WALL - door))
        for a, b in ((near, begin), (begin + door, far)):
            center, size = [at, (a + b) / 2], [WALL, b - a]
            obstacles.append(_box(center if upright else center[::-1], size if upright else size[::-1]))
        rooms += [(x0, y0, at, y1), (at, y0, x1, y1)] if upright else [(x0, y0, x1, at), (x0, at, x1, y1)]
    return obstacles


def _box(center: list[float], size: list[float], angle: float = 0.0) -> Fields:
    return {"shape": "box", "center": center, "size": size, "angle": angle}


def _clutter(generator: np.random.Generator, width: float, height: float) -> list[Fields]:
    return [_thing(generator, width, height) for _ in range(generator.integers(30, 60))]


def _thing(generator: np.random.Generator, width: float, height: float) -> Fields:
    center = generator.uniform([0.0, 0.0], [width, height])
    match generator.integers(3):
        case 0:
            return {"shape": "circle", "center": center.tolist(), "radius": float(generator.uniform(0.15, 0.6))}
        case 1:
            size = generator.uniform(0.2, 2.5, 2).tolist()
            return _box(center.tolist(), size, float(generator.uniform(0.0, np.pi)))
        case _:
            count = int(generator.integers(3, 8))
            bearings = (np.arange(count) + generator.uniform(0.1, 0.9, count)) * 2.0 * np.pi / count
            radii = generator.uniform(0.2, 1.0, count)
            corners = center + (radii * np.array([np.cos(bearings), np.sin(bearings)])).T
            return {"shape": "polygon", "vertices": corners.tolist()}


# Solving them by the defaults -----------------------------------------------------------------------------------------
FAMILIES: dict[str, Callable[[int], ProblemFile]] = {
    "three-rooms": three_room_world,
    "narrow-doors": narrow_door_world,
    "rooms-and-clutter": robot_world,
}


class Row(NamedTuple):
    """The outcome of one floor."""

    solved: bool
    seconds: float | None
    evaluations: int
    ratio: float | None  # of the length to the oracle's lower bound, if the floor was solved


def main() -> None:
    """Print the floors that failed or have long ways, then the figures of all floors."""
    parser = argparse.ArgumentParser(description="Solve random floors by the defaults on a torus of 4 × 4.")
    parser.add_argument("--floors", choices=FAMILIES, default="three-rooms", help="which family")
    parser.add_argument("--seeds", type=int, default=100, help="how many floors")
    parser.add_argument("--first", type=int, default=1, help="the number of the first")
    parser.add_argument("--simulate", action="store_true", help="in this process, without seconds")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.seeds)
    runs = simulated if options.simulate else on_a_cluster
    rows = []
    for number, row in zip(
        numbers, runs([FAMILIES[options.floors](number) for number in numbers], numbers), strict=True
    ):
        rows.append(row)
        if not row.solved:
            print(f"floor {number}: not solved after {row.evaluations:,} evaluations", flush=True)
        elif row.ratio is not None and row.ratio > 1.1:
            print(f"floor {number}: {row.ratio:.2f} times the lower bound of the length", flush=True)
    print(summary(rows))


def on_a_cluster(files: list[ProblemFile], seeds: range) -> Iterator[Row]:
    """Yield the outcomes of jobs on one cluster, which is up before the first submit."""
    with supernode.LocalCluster(topology="torus 4x4") as cluster:
        cluster.submit(files[0], generations=2).result()
        for file, seed in zip(files, seeds, strict=True):
            began = time.perf_counter()
            result = cluster.submit(file, seed=seed).result()
            yield _row(file, result, time.perf_counter() - began)


def simulated(files: list[ProblemFile], seeds: range) -> Iterator[Row]:
    """Yield the outcomes of the same jobs, simulated in this process."""
    for file, seed in zip(files, seeds, strict=True):
        yield _row(file, supernode.simulate(file, seed=seed, topology="torus 4x4"), None)


def _row(file: ProblemFile, result: Result, seconds: float | None) -> Row:
    solved, ratio = result.solved and result.feasible, None
    if solved:
        least = file.problem().oracle().figures["shortest_length_at_least"]
        ratio = result.solution["length"] / least if least > 0.0 else 1.0
    return Row(solved, seconds, result.evaluations, ratio)


def summary(rows: list[Row]) -> str:
    """Return lines with the number of solved floors, and the figures of the solved ones."""
    good = [row for row in rows if row.solved]
    lines = [f"solved: {len(good)} of {len(rows)}"]
    seconds = [row.seconds for row in good if row.seconds is not None]
    if seconds:
        lines.append(f"seconds: {np.median(seconds):.3f} in the median, {np.quantile(seconds, 0.95):.3f} for 95 %")
    if good:
        lines.append(f"evaluations: {np.median([row.evaluations for row in good]):,.0f} in the median")
        ratios = [row.ratio for row in good if row.ratio is not None]
        lines.append(
            f"length / lower bound: {np.median(ratios):.3f} in the median, {np.quantile(ratios, 0.95):.3f} for 95 %"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
