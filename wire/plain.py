"""What JSON can say: it has no numbers that are not finite."""

import math
from typing import Any


def plain(value: Any) -> Any:
    """``value`` with null in place of each number that is not finite, however deep in it, and lists for tuples."""
    if isinstance(value, dict):
        return {name: plain(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
