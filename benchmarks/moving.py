"""A world that moves: how soon a kept-alive job has replanned, beside planning from scratch.

Usage: python -m benchmarks.moving [--updates 100] [--torus 4x4]

A script moves obstacles, one update after another. For each the clock runs from the call of ``update`` to the first
answer for the new world that is good enough and accepted by `check`: for mobile-robot one that reaches the goal, for
terrain one within 5 % of the exact optimum. The same world is then planned from scratch, on a second cluster that is up
as well: from the call of ``submit``.
"""

import argparse
import queue
import random
import statistics
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import supernode
from supernode import Improvement, Job, LocalCluster, ProblemFile

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
PROMPT = 0.2  # seconds
PATIENCE = 5.0  # seconds, after which an update counts as not replanned
NEAR = 1.05


class Timed(NamedTuple):
    """Seconds until there was a good answer; None if none came in time."""

    update: float | None
    scratch: float | None


class Mover(NamedTuple):
    """A problem whose world moves.

    Attributes:
        moved: other fields of the problem, by chance.
        good: what fitness is good enough in a world.
    """

    file: ProblemFile
    moved: Callable[[ProblemFile, random.Random], dict[str, Any]]
    good: Callable[[ProblemFile], float]


def main() -> None:
    """Print a row for each problem."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--updates", type=int, default=100)
    parser.add_argument("--torus", default="4x4")
    options = parser.parse_args()
    print("| problem | updates | replanned within 200 ms | median, 90 % / ms | from scratch | ratio of medians |")
    print("|---|---|---|---|---|---|")
    for name, mover in (("mobile-robot", _robot()), ("terrain", _terrain())):
        print(_row(name, measure(mover, options.updates, f"torus {options.torus}")), flush=True)


def measure(mover: Mover, updates: int, topology: str) -> list[Timed]:
    """Move the world so many times; only worlds are counted that one of the two ways found a good answer for."""
    source = random.Random(1992)
    timed: list[Timed] = []
    with (
        LocalCluster(topology=topology) as living,
        LocalCluster(topology=topology) as fresh,
        _kept_alive(living, mover) as (job, news),
    ):
        file = mover.file
        while len(timed) < updates:
            fields = mover.moved(file, source)
            began = time.perf_counter()
            try:
                world = job.update(**fields)
            except supernode.BadInput:  # the start or the goal was covered
                continue
            file = file.changed(fields, {})
            good = mover.good(file)
            replanned = _until_good(news, began, world, good)
            timed.append(Timed(replanned, _from_scratch(fresh, file, good, len(timed))))
    return [each for each in timed if each != Timed(None, None)]


@contextmanager
def _kept_alive(cluster: LocalCluster, mover: Mover) -> Iterator[tuple[Job, "_News"]]:
    job = cluster.submit(mover.file, keep_alive=True, stall=200, seed=1)
    news = _News(job)
    try:
        _until_good(news, time.perf_counter(), 0, mover.good(mover.file))
        yield job, news
    finally:
        job.cancel()


class _News:
    """Improvements of a job, with a patience."""

    def __init__(self, job: Job) -> None:
        self._queue: queue.SimpleQueue[Improvement] = queue.SimpleQueue()
        threading.Thread(target=self._read, args=(job,), daemon=True).start()

    def _read(self, job: Job) -> None:
        for better in job.improvements():
            self._queue.put(better)

    def next(self, seconds: float) -> Improvement | None:
        """The next one; None if there is none so soon."""
        try:
            return self._queue.get(timeout=max(0.0, seconds))
        except queue.Empty:
            return None


def _until_good(news: _News, began: float, world: int, good: float) -> float | None:
    while (better := news.next(began + PATIENCE - time.perf_counter())) is not None:
        if better.world == world and better.feasible and better.fitness <= good:
            return time.perf_counter() - began
    return None


def _from_scratch(cluster: LocalCluster, file: ProblemFile, good: float, number: int) -> float | None:
    began = time.perf_counter()
    job = cluster.submit(file, seed=2 + number, stall=200, seconds=PATIENCE, target=good)
    seconds = None
    for better in job.improvements():
        if seconds is None and better.feasible and better.fitness <= good:
            seconds = time.perf_counter() - began
    return seconds


def _robot() -> Mover:
    """A box of the office is somewhere else."""

    def moved(file: ProblemFile, source: random.Random) -> dict[str, Any]:
        obstacles = [dict(each) for each in file.fields["obstacles"]]
        movable = [each for each in obstacles if each["shape"] == "box" and max(each["size"]) <= 1.5]
        box = source.choice(movable)
        box["center"] = [at + source.uniform(-0.5, 0.5) for at in box["center"]]
        return {"obstacles": obstacles}

    return Mover(supernode.load(EXAMPLES / "mobile-robot.toml"), moved, lambda _: 0.0)


def _terrain() -> Mover:
    """An obstacle of one cell more, and one less."""

    def moved(file: ProblemFile, source: random.Random) -> dict[str, Any]:
        rows = [list(row) for row in file.fields["map"]]
        taken = {tuple(file.fields["start"]), tuple(file.fields["goal"])}
        cells = [(row, column) for row in range(len(rows)) for column in range(len(rows[0]))]
        free = [cell for cell in cells if rows[cell[0]][cell[1]] == "." and cell not in taken]
        row, column = source.choice(free)
        rows[row][column] = "#"
        if blocked := [cell for cell in cells if rows[cell[0]][cell[1]] == "#" and cell != (row, column)]:
            row, column = source.choice(blocked)
            rows[row][column] = "."
        return {"map": ["".join(row) for row in rows]}

    return Mover(supernode.load(EXAMPLES / "terrain.toml"), moved, lambda file: NEAR * _optimum(file))


def _optimum(file: ProblemFile) -> float:
    answer = file.problem().oracle()
    return float("inf") if answer.fitness is None else answer.fitness


def _row(name: str, timed: list[Timed]) -> str:
    updates = [PATIENCE if each.update is None else each.update for each in timed]
    scratch = [PATIENCE if each.scratch is None else each.scratch for each in timed]
    prompt = sum(seconds <= PROMPT for seconds in updates) / len(updates)
    late = statistics.quantiles(updates, n=10)[-1]
    middle, other = statistics.median(updates), statistics.median(scratch)
    return (
        f"| {name} | {len(timed)} | {prompt:.0%} | {1e3 * middle:.0f}, {1e3 * late:.0f} | {1e3 * other:.0f} "
        f"| {other / middle:.1f} |"
    )


if __name__ == "__main__":
    main()
