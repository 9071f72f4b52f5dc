"""The least of a distance along motions, to a stated accuracy: the method of Piyavskii (1972) and Shubert (1972).

Nothing of a body moves farther than a known way on a stretch of a motion, so a distance changes by no more than that on
it. Two distances at the ends of a stretch bound all between them from below; stretches whose bound is least are halved.
"""

import heapq
from collections.abc import Callable, Sequence

MOST = 20_000
"""Distances that are measured at most; then the bound that is known by then is the answer."""


def least_along(
    measure: Callable[[int, float], float], ways: Sequence[float], accuracy: float
) -> tuple[float, int, float]:
    """The least distance on some motions, and where it is.

    Args:
        measure: the distance at a motion, by its number, and the share of it that is done, from 0 to 1.
        ways: how far anything moves at most on each motion, in the unit of the distance.
        accuracy: by which the answer may be more than the least distance; never by more.

    Returns:
        the distance, and the number of the motion and its share at which the least was measured.
    """
    best, where = float("inf"), (0, 0.0)
    stretches: list[tuple[float, int, tuple[float, float], tuple[float, float]]] = []

    def at(motion: int, share: float) -> float:
        nonlocal best, where
        distance = measure(motion, share)
        if distance < best:
            best, where = distance, (motion, share)
        return distance

    def push(motion: int, ends: tuple[float, float], distances: tuple[float, float]) -> None:
        bound = (sum(distances) - ways[motion] * (ends[1] - ends[0])) / 2
        heapq.heappush(stretches, (bound, motion, ends, distances))

    for motion in range(len(ways)):
        push(motion, (0.0, 1.0), (at(motion, 0.0), at(motion, 1.0)))
    for _ in range(MOST):
        if not stretches or stretches[0][0] >= best - accuracy:
            break
        _, motion, (begin, end), (first, last) = heapq.heappop(stretches)
        middle = (begin + end) / 2
        distance = at(motion, middle)
        push(motion, (begin, middle), (first, distance))
        push(motion, (middle, end), (distance, last))
    least = min(best, stretches[0][0] + accuracy) if stretches else best
    return least, *where
