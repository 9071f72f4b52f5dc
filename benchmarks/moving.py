"""Measure how soon a kept-alive job has replanned when obstacles move, beside planning from scratch.

Usage: python -m benchmarks.moving [--updates 100] [--torus 4x4]

Two clusters are up (`supernode up`). On one of them this script moves obstacles of a kept-alive job, one update after
another. The clock runs from the call of ``update`` to the first answer for the new epoch that the client receives,
that `check` accepts, and that is good enough: for mobile-robot it reaches the goal, for terrain it is within 5 % of
the exact optimum. The same world is then planned from scratch on the other cluster, from the call of ``submit`` on.
Worlds for which the planner's oracle cannot prove an answer are not counted. Memory is the private part of the
processes of the first cluster, before the first update and after the last one.
"""

import argparse
import queue
import random
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import supernode
from benchmarks.service import held_by, up
from supernode import Client, ClientJob, Improvement, ProblemFile

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
PROMPT = 0.2  # seconds
PATIENCE = 5.0  # seconds, after which an update counts as not replanned
NEAR = 1.05


class Timed(NamedTuple):
    """Seconds until the first good answer; None if none arrived in time."""

    update: float | None
    scratch: float | None


class Mover(NamedTuple):
    """A problem whose obstacles move.

    Attributes:
        moved: returns randomly changed fields of the problem.
        good: returns the fitness that is good enough in a world, or None if its oracle cannot say.
    """

    file: ProblemFile
    moved: Callable[[ProblemFile, random.Random], dict[str, Any]]
    good: Callable[[ProblemFile], float | None]


class Moved(NamedTuple):
    """The outcome of the updates; memory in bytes, by process, before and after them."""

    timed: list[Timed]
    before: dict[str, int]
    after: dict[str, int]


def main() -> None:
    """Print one row for each problem."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--updates", type=int, default=100)
    parser.add_argument("--torus", default="4x4")
    options = parser.parse_args()
    print(
        "| problem | worlds | replanned within 200 ms | median, 90 % / ms | from scratch | ratio of medians "
        "| memory of coordinator, nodes / MB |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, mover in (("mobile-robot", _robot()), ("terrain", _terrain())):
        print(_row(name, measure(mover, options.updates, f"torus {options.torus}")), flush=True)


def measure(mover: Mover, updates: int, topology: str) -> Moved:
    """Update the problem until ``updates`` worlds are counted."""
    source = random.Random(1992)
    timed: list[Timed] = []
    with _service(topology) as (living, process), _service(topology) as (fresh, _), _kept_alive(living, mover) as job:
        file, news, before = mover.file, _News(job), _memory(process)
        while len(timed) < updates:
            fields = mover.moved(file, source)
            began = time.perf_counter()
            try:
                epoch = job.update(**fields)
            except supernode.BadInput:  # an obstacle covers the start or the goal
                continue
            file = file.changed(fields, {})
            good = mover.good(file)
            if good is not None:
                replanned = _until_good(news, began, epoch, good)
                timed.append(Timed(replanned, _from_scratch(fresh, file, good, len(timed))))
        return Moved(timed, before, _memory(process))


@contextmanager
def _service(topology: str) -> Iterator[tuple[Client, int]]:
    """Start a cluster; yield a client of it and the process id of `supernode up`."""
    with (
        tempfile.TemporaryDirectory() as folder,
        up(Path(folder), topology) as process,
        supernode.connect(folder) as client,
    ):
        yield client, process


@contextmanager
def _kept_alive(client: Client, mover: Mover) -> Iterator[ClientJob]:
    job = client.submit(mover.file, keep_alive=True, stall=200, seed=1)
    try:
        job.answer(PATIENCE)
        yield job
    finally:
        job.cancel()
        job.end(PATIENCE)


def _memory(process: int) -> dict[str, int]:
    return {name: held.memory for name, held in held_by(process).items()}


class _News:
    """Improvements of a job, each with the time at which it was received."""

    def __init__(self, job: ClientJob) -> None:
        self._queue: queue.SimpleQueue[tuple[float, Improvement]] = queue.SimpleQueue()
        threading.Thread(target=self._read, args=(job,), daemon=True).start()

    def _read(self, job: ClientJob) -> None:
        for better in job.improvements():
            self._queue.put((time.perf_counter(), better))

    def next(self, until: float) -> tuple[float, Improvement] | None:
        """Return the next improvement, or None if none arrives before the time ``until``."""
        try:
            return self._queue.get(timeout=max(0.0, until - time.perf_counter()))
        except queue.Empty:
            return None


def _until_good(news: _News, began: float, epoch: int, good: float) -> float | None:
    while (heard := news.next(began + PATIENCE)) is not None:
        at, better = heard
        if better.epoch == epoch and better.feasible and better.fitness <= good:
            return at - began
    return None


def _from_scratch(client: Client, file: ProblemFile, good: float, number: int) -> float | None:
    began = time.perf_counter()
    job = client.submit(file, seed=2 + number, stall=200, seconds=PATIENCE, target=good)
    seconds = None
    for better in job.improvements():
        if seconds is None and better.feasible and better.fitness <= good:
            seconds = time.perf_counter() - began
    return seconds


def _robot() -> Mover:
    """Return the office, in which each update moves one box."""

    def moved(file: ProblemFile, source: random.Random) -> dict[str, Any]:
        obstacles = [dict(each) for each in file.fields["obstacles"]]
        movable = [each for each in obstacles if each["shape"] == "box" and max(each["size"]) <= 1.5]
        box = source.choice(movable)
        box["center"] = [at + source.uniform(-0.5, 0.5) for at in box["center"]]
        return {"obstacles": obstacles}

    return Mover(supernode.load(EXAMPLES / "mobile-robot.toml"), moved, _optimum)


def _terrain() -> Mover:
    """Return a terrain, in which each update adds an obstacle of one cell and removes another."""

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

    def near(file: ProblemFile) -> float | None:
        optimum = _optimum(file)
        return None if optimum is None else NEAR * optimum

    return Mover(supernode.load(EXAMPLES / "terrain.toml"), moved, near)


def _optimum(file: ProblemFile) -> float | None:
    answer = file.problem().oracle()
    return answer.fitness if answer.meaning == "optimum" else None


def _row(name: str, moved: Moved) -> str:
    updates = [PATIENCE if each.update is None else each.update for each in moved.timed]
    scratch = [PATIENCE if each.scratch is None else each.scratch for each in moved.timed]
    prompt = sum(seconds <= PROMPT for seconds in updates) / len(updates)
    late = statistics.quantiles(updates, n=10)[-1]
    middle, other = statistics.median(updates), statistics.median(scratch)
    memory = ", ".join(
        f"{moved.before[each] / 1e6:.1f} → {moved.after[each] / 1e6:.1f}" for each in ("coordinator", "nodes")
    )
    return (
        f"| {name} | {len(updates)} | {prompt:.0%} | {1e3 * middle:.0f}, {1e3 * late:.0f} | {1e3 * other:.0f} "
        f"| {other / middle:.1f} | {memory} |"
    )


if __name__ == "__main__":
    main()
