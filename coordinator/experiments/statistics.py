"""Confidence intervals of 95 % over repeats.

Medians, means and ratios of medians get bootstrap intervals (percentiles of resampled values, which need no assumption
about the distribution and stay within the data). Rates of success get Wilson's intervals, which also hold for few
repeats.
"""

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
_RESAMPLES = 4999
_SEED = 1992  # fixed, so that the same runs give the same report
_NEVER = 1e150  # stands for an infinite cost, so that medians and quotients of resampled costs stay finite


@dataclass(frozen=True)
class Estimate:
    """A number and its interval.

    Attributes:
        value: the number.
        low, high: the bounds of the interval; None if there is none (a single value, a sum, too few runs).
        count: the number of values that it rests on.
    """

    value: float
    low: float | None
    high: float | None
    count: int

    def divided_by(self, divisor: float) -> "Estimate":
        """Return this estimate in another unit, ``divisor`` times as large."""
        low, high = (None if bound is None else bound / divisor for bound in (self.low, self.high))
        return Estimate(self.value / divisor, low, high, self.count)

    def is_above(self, bound: float) -> bool:
        """Return whether the whole interval is above ``bound``."""
        return self.low is not None and self.low > bound


def median(values: Sequence[float]) -> Estimate | None:
    """Return the median; None of no values. Infinite values are allowed."""
    return _bootstrapped(np.median, values)


def mean(values: Sequence[float]) -> Estimate | None:
    """Return the mean; None of no values."""
    return _bootstrapped(np.mean, values)


def proportion(successes: int, count: int) -> Estimate | None:
    """Return the rate of success; None of no tries."""
    if count == 0:
        return None
    interval = stats.binomtest(successes, count).proportion_ci(confidence_level=CONFIDENCE, method="wilson")
    return Estimate(successes / count, float(interval.low), float(interval.high), count)


def ratio_of_medians(above: Sequence[float], below: Sequence[float]) -> Estimate | None:
    """Return the ratio of two medians; None unless both are finite. A run that missed the target costs infinity."""
    if not above or not below:
        return None
    upper, lower = statistics.median(above), statistics.median(below)
    if not (math.isfinite(upper) and math.isfinite(lower)):
        return None
    count = min(len(above), len(below))
    if count < 2:
        return Estimate(upper / lower, None, None, count)
    low, high = _interval([_finite(above), _finite(below)], _quotient)
    return Estimate(upper / lower, low, high, count)


def _quotient(above: Any, below: Any, axis: int) -> Any:
    """Return the quotient of medians; 0 where the divisor is infinite, which can only weaken a claim."""
    upper, lower = np.median(above, axis=axis), np.median(below, axis=axis)
    return np.where(lower >= _NEVER / 2, 0.0, upper / lower)


def _bootstrapped(statistic: Any, values: Sequence[float]) -> Estimate | None:
    if not values:
        return None
    sample = _finite(values)
    value = _infinite(float(statistic(sample)))
    if len(values) == 1:
        return Estimate(value, None, None, 1)
    low, high = _interval([sample], statistic)
    return Estimate(value, low, high, len(values))


def _interval(samples: list[Any], statistic: Any) -> tuple[float, float]:
    result = stats.bootstrap(
        samples,
        statistic,
        n_resamples=_RESAMPLES,
        confidence_level=CONFIDENCE,
        method="percentile",
        vectorized=True,
        rng=np.random.default_rng(_SEED),
    )
    bounds = result.confidence_interval
    low, high = sorted((_infinite(float(bounds.low)), _infinite(float(bounds.high))))  # rounding may swap equals
    return low, high


def _finite(values: Sequence[float]) -> Any:
    return np.array([min(value, _NEVER) for value in values], dtype=float)


def _infinite(value: float) -> float:
    return math.inf if value >= _NEVER / 1e20 else value
