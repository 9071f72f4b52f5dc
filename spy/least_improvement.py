"""The least improvement worth a line: real-valued fitness may improve hundreds of times a second, by ever less."""

import math

LEAST = 1e-3
"""The default of the least improvement that gets a line, as a share of the fitness before."""


def is_worth_telling(before: float, now: float, least: float) -> bool:
    """Return whether the fitness ``now`` is better than ``before`` by more than the share ``least`` of ``before``."""
    return now < before and (not math.isfinite(before) or before - now > least * abs(before))
