"""What the counters of all nodes of a job come to."""

import math
from collections.abc import Sequence
from statistics import median

from topologies import ROOT
from wire.news import Counters, Statistics


def added_up(counters: Sequence[Counters], job: int, epoch: int, generation: int) -> Statistics:
    """The sums, and how the individuals are spread; of no node at all, as if there were none.

    Args:
        counters: the latest of each node.
        job: its number.
        epoch: of it, that they are of.
        generation: of the root.
    """
    champion = next((each for each in counters if each.cell == ROOT), None)
    return Statistics(
        job,
        epoch,
        generation,
        sum(each.evaluations for each in counters),
        sum(each.sent for each in counters),
        sum(each.received for each in counters),
        sum(each.lost for each in counters),
        sum(each.rejected for each in counters),
        len(counters),
        0.0,
        min((each.best for each in counters), default=math.inf),
        median(each.median for each in counters) if counters else math.inf,
        max((each.worst for each in counters), default=math.inf),
        0 if champion is None else champion.age,
        len({each.digest for each in counters}) / max(1, len(counters)),
        median(each.exchange_seconds for each in counters) if counters else math.inf,
    )
