"""Whether a parallel search is cheaper than the best sequential one: simultaneous intervals, verdicts and null models.

The efficiency of n nodes in evaluations is the median cost of the best sequential algorithm over the median cost of all
n nodes together. Which sequential algorithm is the best is itself estimated: each bootstrap replicate chooses anew.
All efficiencies of an experiment are judged at once, by the maximum of their studentised bootstrap deviations (max-t;
Westfall and Young 1993, *Resampling-Based Multiple Testing*, Wiley), so that the chance of any wrong claim is 5 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from coordinator.scaling.statistics import CONFIDENCE, Estimate

Verdict = Literal["shown", "not shown", "undecided"]

FEWEST_SEEDS = 20
"""With fewer runs of either side nothing is claimed: with 3 runs, 95 % bootstrap intervals of medians cover 89 %."""

_REPLICATES = 1999
_SEED = 1992  # the same runs give the same verdict
_FURTHEST = 20.0  # of a logarithm of a ratio: stands for infinity, of runs that did not get there


@dataclass(frozen=True)
class Comparison:
    """One parallel search beside the best sequential one.

    Attributes:
        efficiency: with its simultaneous interval; None if half of the runs of either side failed.
        verdict: of super-linear speed-up: "shown" if the whole interval is above 1, "not shown" if none of it is.
        seeds: that would decide, about, if the efficiency is what it seems to be; None if it is decided, or hopeless.
    """

    efficiency: Estimate | None
    verdict: Verdict
    seeds: int | None = None


def compare(sequential: Sequence[Sequence[float]], parallel: Sequence[Sequence[float]]) -> list[Comparison]:
    """Compare all at once.

    Args:
        sequential: the costs of each sequential algorithm, run by run; infinite where the target was not reached.
        parallel: the costs of all nodes together, of each place on each curve, run by run.
    """
    draws = np.random.default_rng(_SEED)
    best, best_draws = _best(sequential, draws)
    drawn = [_medians(costs, draws) for costs in parallel]
    ratios = np.array([_log_ratio(best, _median(costs)) for costs in parallel])
    deviations = np.array([_log_ratio(best_draws, each) for each in drawn]).reshape(len(parallel), -1)
    deviations -= ratios[:, None]
    spread = deviations.std(axis=1)
    known = [place for place, costs in enumerate(parallel) if math.isfinite(best) and math.isfinite(_median(costs))]
    reach = _reach(deviations[known], spread[known])
    fewest = min(map(len, sequential), default=0)
    return [
        _judged(ratios[place], reach * spread[place], min(fewest, len(costs))) if place in known else _unknown()
        for place, costs in enumerate(parallel)
    ]


def first_of(costs: Sequence[float], runs: int) -> float:
    """The median cost of the first to end of so many independent runs, each with the ``costs``' distribution.

    A null model of a parallel search: it needs no message (Verhoeven and Aarts 1995, "Parallel local search",
    J. Heuristics 1:43-65). Of more runs than half of the costs it is hardly more than the least of them.
    """
    return float(np.quantile(_finite(costs), 1.0 - 0.5 ** (1.0 / runs), method="inverted_cdf"))


def with_restarts(costs: Sequence[float]) -> tuple[float, float]:
    """The mean cost of a search that begins anew after the best cutoff, and that cutoff.

    The mean to the first success is the mean of min(cost, cutoff) over the share that gets there (Luby, Sinclair and
    Zuckerman 1993, "Optimal speedup of Las Vegas algorithms"). The same runs choose the cutoff, which flatters it.
    """
    sample = np.sort(_finite(costs))
    cutoffs = sample[np.isfinite(sample)]
    if not cutoffs.size:
        return math.inf, math.inf
    means = [float(np.minimum(sample, cutoff).sum() / (sample <= cutoff).sum()) for cutoff in cutoffs]
    least = int(np.argmin(means))
    return means[least], float(cutoffs[least])


def merit(costs: Sequence[float]) -> tuple[int, float]:
    """Return how many runs failed, and the median cost: of algorithms with as many runs the least is the best."""
    return sum(map(math.isinf, costs)), _median(costs)


def _best(sequential: Sequence[Sequence[float]], draws: np.random.Generator) -> tuple[float, Any]:
    """The median cost of the algorithm that failed least often, among equals the cheapest; and in each replicate."""
    failures, best = np.full(1 + _REPLICATES, np.inf), np.full(1 + _REPLICATES, np.inf)
    for costs in sequential:
        if costs:
            drawn = np.vstack([_finite(costs), _resampled(costs, draws)])
            failing, medians = np.isinf(drawn).mean(axis=1), np.median(drawn, axis=1)
            is_better = (failing < failures) | ((failing == failures) & (medians < best))
            failures, best = np.where(is_better, failing, failures), np.where(is_better, medians, best)
    return float(best[0]), best[1:]


def _resampled(costs: Sequence[float], draws: np.random.Generator) -> Any:
    """Costs drawn again, (replicates, costs)."""
    sample = _finite(costs)
    return sample[draws.integers(0, sample.size, (_REPLICATES, sample.size))]


def _medians(costs: Sequence[float], draws: np.random.Generator) -> Any:
    """Of resampled costs, (replicates,)."""
    return np.median(_resampled(costs, draws), axis=1) if costs else np.full(_REPLICATES, np.inf)


def _median(costs: Sequence[float]) -> float:
    return float(np.median(_finite(costs))) if costs else math.inf


def _finite(costs: Sequence[float]) -> Any:
    return np.array(costs, float)


def _log_ratio(above: Any, below: Any) -> Any:
    """Within bounds; 0 where neither side got there."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.nan_to_num(np.log(above) - np.log(below), nan=0.0, posinf=_FURTHEST, neginf=-_FURTHEST)
    return np.clip(ratio, -_FURTHEST, _FURTHEST)


def _reach(deviations: Any, spread: Any) -> float:
    """How many spreads an interval reaches to either side, so that all hold at once."""
    moving = spread > 0
    if not moving.any():
        return 0.0
    return float(np.quantile(np.abs(deviations[moving] / spread[moving, None]).max(axis=0), CONFIDENCE))


def _judged(ratio: float, reach: float, runs: int) -> Comparison:
    estimate = Estimate(math.exp(ratio), math.exp(ratio - reach), math.exp(ratio + reach), runs)
    if runs < FEWEST_SEEDS:
        return Comparison(Estimate(estimate.value, None, None, runs), "undecided", FEWEST_SEEDS)
    if ratio - reach > 0:
        return Comparison(estimate, "shown")
    if ratio + reach <= 0:
        return Comparison(estimate, "not shown")
    return Comparison(estimate, "undecided", math.ceil(runs * (reach / ratio) ** 2) if ratio else None)


def _unknown() -> Comparison:
    return Comparison(None, "undecided")
