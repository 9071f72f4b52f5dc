"""Which improvements are worth a line: of real numbers there may be hundreds a second, each by less than the last."""

import math

LEAST = 1e-3
"""The least improvement that is told if nothing else is asked for, as a share of the fitness before."""


def is_worth_telling(before: float, now: float, least: float) -> bool:
    """Whether a fitness is better than the one ``before`` by more than the share ``least`` of that."""
    return now < before and (not math.isfinite(before) or before - now > least * abs(before))
