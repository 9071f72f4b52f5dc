"""The outcomes of solvers on robot-path problems, and the table of them. `benchmarks.robots` describes its columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from problems import ProblemFile

MOMENTS = (0.1, 1.0, 5.0)  # s, at which lengths are compared
LATE = 1.05  # of the seconds, after which no path counts; a path may be seen a little after it was found
REFUSED = "refused: "


@dataclass
class Outcome:
    """The outcome of one problem.

    Attributes:
        found: when each better path was known, s from the beginning, its length, and whether the proof accepts it.
        proven: whether the proof accepts the last path.
        cpu: processor time, s.
        message: why the problem was refused, or the run failed.
        until: s, after which no path counts.
        pace: the length of a second of `MOMENTS` for this solver, s; not 1 if it was given as much CPU time as another.
    """

    found: list[tuple[float, float, bool]] = field(default_factory=list)
    proven: bool = False
    cpu: float = 0.0
    message: str | None = None
    until: float = math.inf
    pace: float = 1.0

    @property
    def first(self) -> float:
        """When the first proven path was known, s."""
        return min((at for at, _, proven in self.found if proven and at <= self.until), default=math.inf)

    @property
    def is_refused(self) -> bool:
        """Whether there was nothing to solve, as the start or the goal touches something."""
        return str(self.message).startswith(REFUSED)

    def length_at(self, moment: float) -> float:
        """The length of the best proven path that was known at a moment, rad."""
        until = min(moment * self.pace, self.until)
        return min((length for at, length, proven in self.found if proven and at <= until), default=math.nan)


Solver = Callable[[ProblemFile, float], Outcome]

_WIDTH = 34  # of names
HEAD = (
    f"{'':{_WIDTH}} {'runs':>4} {'bad':>4} {'solved':>6} {'proven':>6} {'first':>7} {'95 %':>7} "
    + " ".join(f"{'at ' + format(moment, 'g') + ' s':>8}" for moment in MOMENTS)
    + f" {'at end':>8} {'CPU':>7}\n{'':{_WIDTH + 24}} {'ms':>7} {'ms':>7} "
    + " ".join(f"{'rad':>8}" for _ in range(len(MOMENTS) + 1))
    + f" {'s':>7}"
)


def head(reference: str | None = None) -> str:
    """Return the head of the table, with the columns of ratios if rows are compared with those of a reference."""
    if reference is None:
        return HEAD
    first, second = HEAD.split("\n")
    return f"{first} {'÷ ' + reference:>22}\n{second} {'both':>5} {'first':>8} {'length':>7}"


def row(name: str, outcomes: Sequence[Outcome], reference: Sequence[Outcome] | None = None) -> str:
    """Return a line of the table.

    Args:
        name: the name of the line.
        outcomes: those of one solver.
        reference: another solver's outcomes of the same problems. The line then ends with the number of problems that
            both solved, and the geometric means of the ratios of the times to the first proven path and of the lengths
            at the end.
    """
    ran = [each for each in outcomes if not each.is_refused]
    first = np.array([each.first for each in ran if math.isfinite(each.first)])
    times = f"{_ms(np.median(first))} {_ms(np.percentile(first, 95))}" if first.size else f"{'–':>7} {'–':>7}"
    lengths = " ".join(_known(_mean([each.length_at(moment) for each in ran]), 8) for moment in (*MOMENTS, math.inf))
    solved, proven = first.size, sum(each.proven for each in ran)
    counts = f"{len(ran):4} {len(outcomes) - len(ran):4} {solved:6} {proven:6}"
    line = f"{name:{_WIDTH}} {counts} {times} {lengths} {_mean([each.cpu for each in ran]):7.2f}"
    return line if reference is None else f"{line} {_ratios(outcomes, reference)}"


def _ratios(outcomes: Sequence[Outcome], reference: Sequence[Outcome]) -> str:
    pairs = [
        (one, other) for one, other in zip(outcomes, reference, strict=True) if max(one.first, other.first) < math.inf
    ]
    times = [one.first / other.first for one, other in pairs]
    lengths = [one.length_at(math.inf) / other.length_at(math.inf) for one, other in pairs]
    return f"{len(pairs):5} {_known(_geometric_mean(times), 8)} {_known(_geometric_mean(lengths), 7)}"


def _geometric_mean(values: list[float]) -> float:
    return float(np.exp(np.mean(np.log(values)))) if values else math.nan


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:7.0f}" if seconds >= 0.1 else f"{1e3 * seconds:7.1f}"


def _known(value: float, width: int) -> str:
    return f"{'–':>{width}}" if math.isnan(value) else f"{value:{width}.3f}"


def _mean(values: list[float]) -> float:
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else math.nan
