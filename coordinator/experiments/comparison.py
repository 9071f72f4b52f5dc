"""Decide whether a parallel search is cheaper than the best sequential one: simultaneous intervals and null models.

The efficiency of n nodes in evaluations is the median cost of the best sequential algorithm divided by the median cost
of all n nodes together. Which sequential algorithm is the best is itself an estimate, so each bootstrap replicate
chooses it anew. All efficiencies of an experiment are judged at once, by the maximum of their studentised bootstrap
deviations (max-t; Westfall and Young 1993, *Resampling-Based Multiple Testing*, Wiley), so that the chance of any wrong
claim is 5 %.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from coordinator.experiments.statistics import CONFIDENCE, Estimate

Verdict = Literal["shown", "not shown", "undecided"]

FEWEST_SEEDS = 20
"""With fewer runs of either side nothing is claimed: with 3 runs, 95 % bootstrap intervals of medians cover 89 %."""

_REPLICATES = 1999
_SEED = 1992  # fixed, so that the same runs give the same verdict
_FURTHEST = 20.0  # bound of the logarithm of a ratio; stands for infinity, where runs did not reach the target


@dataclass(frozen=True)
class Comparison:
    """One parallel search compared with the best sequential one.

    Attributes:
        efficiency: the efficiency with its simultaneous interval; None if half of the runs of either side failed.
        verdict: whether super-linear speed-up is "shown" (the whole interval is above 1), "not shown" (none of it is)
            or "undecided".
        seeds: about how many seeds would decide if the efficiency is as estimated; None if it is decided, or no number
            of seeds would decide.
    """

    efficiency: Estimate | None
    verdict: Verdict
    seeds: int | None = None


def compare(sequential: Sequence[Sequence[float]], parallel: Sequence[Sequence[float]]) -> list[Comparison]:
    """Compare parallel searches with the best sequential algorithm, all at once.

    Args:
        sequential: for each sequential algorithm the costs of its runs; infinite where the target was not reached.
        parallel: for each point of each curve the costs of its runs, of all nodes together.

    Returns:
        The comparisons, in the order of ``parallel``.
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
    """Return the median cost of the first of ``runs`` independent runs to end, each distributed as ``costs``.

    This is a null model of a parallel search, which needs no messages (Verhoeven and Aarts 1995, "Parallel local
    search", J. Heuristics 1:43-65). With more runs than half the number of costs it is hardly more than the least cost.
    """
    return float(np.quantile(_finite(costs), 1.0 - 0.5 ** (1.0 / runs), method="inverted_cdf"))


def with_restarts(costs: Sequence[float]) -> tuple[float, float]:
    """Return the mean cost of a search that restarts after the best cutoff, and that cutoff.

    The mean cost to the first success is the mean of min(cost, cutoff) divided by the share of runs that succeed within
    the cutoff (Luby, Sinclair and Zuckerman 1993, "Optimal speedup of Las Vegas algorithms"). The cutoff is chosen by
    the same runs, so the result is biased in favour of restarts.
    """
    sample = np.sort(_finite(costs))
    cutoffs = sample[np.isfinite(sample)]
    if not cutoffs.size:
        return math.inf, math.inf
    means = [float(np.minimum(sample, cutoff).sum() / (sample <= cutoff).sum()) for cutoff in cutoffs]
    least = int(np.argmin(means))
    return means[least], float(cutoffs[least])


def merit(costs: Sequence[float]) -> tuple[int, float]:
    """Return the number of failed runs and the median cost; of algorithms with equally many runs the least is best."""
    return sum(map(math.isinf, costs)), _median(costs)


def _best(sequential: Sequence[Sequence[float]], draws: np.random.Generator) -> tuple[float, Any]:
    """Return the median cost of the best algorithm, in the sample and in each replicate.

    The best is the one that failed least often, among equals the cheapest.
    """
    failures, best = np.full(1 + _REPLICATES, np.inf), np.full(1 + _REPLICATES, np.inf)
    for costs in sequential:
        if costs:
            drawn = np.vstack([_finite(costs), _resampled(costs, draws)])  # row 0 is the sample itself
            failing, medians = np.isinf(drawn).mean(axis=1), np.median(drawn, axis=1)
            is_better = (failing < failures) | ((failing == failures) & (medians < best))
            failures, best = np.where(is_better, failing, failures), np.where(is_better, medians, best)
    return float(best[0]), best[1:]


def _resampled(costs: Sequence[float], draws: np.random.Generator) -> Any:
    """Return costs drawn with replacement, shape (replicates, costs)."""
    sample = _finite(costs)
    return sample[draws.integers(0, sample.size, (_REPLICATES, sample.size))]


def _medians(costs: Sequence[float], draws: np.random.Generator) -> Any:
    """Return the medians of resampled costs, shape (replicates,)."""
    return np.median(_resampled(costs, draws), axis=1) if costs else np.full(_REPLICATES, np.inf)


def _median(costs: Sequence[float]) -> float:
    return float(np.median(_finite(costs))) if costs else math.inf


def _finite(costs: Sequence[float]) -> Any:
    return np.array(costs, float)


def _log_ratio(above: Any, below: Any) -> Any:
    """Return the logarithm of a ratio within bounds; 0 where both sides are infinite."""
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = np.nan_to_num(np.log(above) - np.log(below), nan=0.0, posinf=_FURTHEST, neginf=-_FURTHEST)
    return np.clip(ratio, -_FURTHEST, _FURTHEST)


def _reach(deviations: Any, spread: Any) -> float:
    """Return the half-width of all intervals in units of their spreads, such that all hold at once (max-t)."""
    moving = spread > 0  # a constant has no error and would divide by zero
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
    # An interval shrinks with the root of the number of runs; it must become shorter than the distance to 1.
    return Comparison(estimate, "undecided", math.ceil(runs * (reach / ratio) ** 2) if ratio else None)


def _unknown() -> Comparison:
    return Comparison(None, "undecided")
