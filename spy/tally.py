"""The statistics of a job: the counters of all its nodes, added up."""

import math
from collections.abc import Sequence
from statistics import median

from topologies import ROOT
from wire.news import Counters, Statistics


def statistics_of(counters: Sequence[Counters], job: int, epoch: int, generation: int) -> Statistics:
    """Return the sums of counters and the spread of fitness; ``messages_per_second`` is left 0 for the caller to set.

    Args:
        counters: the latest counters of each node; may be empty, then fitness figures are +inf.
        job: the job's number.
        epoch: the epoch that the counters are of.
        generation: the root's generation.
    """
    # The age is that of the root's champion, which all cells come to know.
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
        len({each.digest for each in counters}) / max(1, len(counters)),  # distinct best genomes, for each node
        median(each.exchange_seconds for each in counters) if counters else math.inf,
    )
