"""Values that JSON can represent: it has neither NaN nor infinities."""

import math
from typing import Any


def plain(value: Any) -> Any:
    """Return ``value`` with None in place of each number that is not finite, at any depth, and lists for tuples."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
