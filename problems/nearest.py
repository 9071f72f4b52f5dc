"""The least distance along motions, to a stated accuracy: the method of Piyavskii (1972) and Shubert (1972).

If no point of a body moves farther than w during a stretch of a motion, distances change by at most w during it. The
distances at both ends of a stretch therefore bound all distances between from below. The stretch with the least bound
is halved until no bound is below the best measured distance by more than the accuracy.
"""

import heapq
from collections.abc import Callable, Sequence

MOST_HALVINGS = 20_000
"""The most halvings; after these, the answer follows from the lower bound known by then."""


def least_along(
    measure: Callable[[int, float], float], travel_bounds: Sequence[float], accuracy: float
) -> tuple[float, int, float]:
    """Return the least distance on some motions, and where it was measured.

    Args:
        measure: returns the distance, given the number of a motion and the share of it that is done, from 0 to 1.
        travel_bounds: for each motion a bound of how far any point moves on it, in the unit of the distance.
        accuracy: the most by which the answer may exceed the least distance.

    Returns:
        the distance, and the number of the motion and the share at which the least distance was measured.
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
        # Two lines, falling from one end and rising to the other with the greatest slope, cross at this height.
        bound = (sum(distances) - travel_bounds[motion] * (ends[1] - ends[0])) / 2
        heapq.heappush(stretches, (bound, motion, ends, distances))

    for motion in range(len(travel_bounds)):
        push(motion, (0.0, 1.0), (at(motion, 0.0), at(motion, 1.0)))
    for _ in range(MOST_HALVINGS):
        if not stretches or stretches[0][0] >= best - accuracy:
            break
        _, motion, (begin, end), (first, last) = heapq.heappop(stretches)
        middle = (begin + end) / 2
        distance = at(motion, middle)
        push(motion, (begin, middle), (first, distance))
        push(motion, (middle, end), (distance, last))
    # Once converged, the least bound is at least best - accuracy, and this is `best`. Out of halvings it may be less.
    least = min(best, stretches[0][0] + accuracy) if stretches else best
    return least, *where
