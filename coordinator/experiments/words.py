"""Numbers as text, and the conclusions in plain words, for the terminal and for the report."""

import math
from collections.abc import Iterable
from itertools import groupby

from coordinator.experiments.statistics import Estimate
from coordinator.experiments.summary import (
    INDEPENDENT,
    STRONG_CPU,
    STRONG_EVALUATIONS,
    WEAK_BALANCE,
    WEAK_TWIN,
    Row,
    Summary,
)

NOTIONS = {
    STRONG_EVALUATIONS: (
        "The median evaluations to the target of the best sequential algorithm of this project, divided by the median "
        "evaluations of one of the n nodes (those of all nodes, divided by n). It compares the searches and knows no "
        "messages. A run that did not reach the target counts as dearer than any that did. Its intervals hold all at "
        "once with 95 % (max-t bootstrap), each replicate of which chooses the best sequential algorithm anew."
    ),
    INDEPENDENT: (
        "A null model: n independent runs of the best sequential algorithm, without a message; the first to reach the "
        "target wins. Cells that exchange are worth their messages only where they are above it."
    ),
    STRONG_CPU: (
        "The median CPU time of the best sequential algorithm, in one process without messages, divided by the median "
        "critical-path CPU time on n nodes, with all that messages cost them. It compares programs: it is no speed-up "
        "of a search."
    ),
    WEAK_TWIN: (
        "Weak and orthodox in Alba's words: the CPU time of the same n-cell run, bit for bit, by the simulator on one "
        "processor and without messages, divided by the critical-path CPU time on n nodes; run by run. In lockstep "
        "only, where such a twin exists. In evaluations it is n by definition, so that is not shown. The simulator may "
        "be a slower program than the nodes': what exceeds n then is no speed-up of a search."
    ),
    WEAK_BALANCE: (
        "The CPU time of all n nodes, divided by the critical-path CPU time. It tells how evenly the work is spread. "
        "Work that only messages cause is on both sides, and it cannot exceed n."
    ),
}
"""The meaning of each kind of speed-up."""

CRITICAL_PATH = (
    "Critical-path CPU time is the CPU time of the node process that used most in a run, without what preparing a job "
    "costs it. A machine with a core for every node would need at least about that long. It is no forecast of a time: "
    "waiting for messages and neighbours is not in it, and it was measured on processes that shared {cores}."
)

SERIES = {
    "fixed-population": "Strong scaling: a population of {population} in all, divided among the nodes; run to the "
    "target.",
    "growing-population": "Weak scaling: the deme on each node is fixed, so the population grows with the nodes; run "
    "to the target.",
    "budget": "Fixed budget: the deme on each node is fixed, and all nodes together make at most {budget} evaluations; "
    "the best fitness reached is compared.",
}


def number(value: float) -> str:
    """Return a number with three significant digits, or with all digits of its integer part."""
    if not math.isfinite(value):
        return "∞"
    if value == 0:
        return "0"
    if abs(value) >= 100:
        return f"{value:,.0f}"
    if abs(value) < 0.001:
        return f"{value:.1e}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"


def interval(estimate: Estimate | None) -> str:
    """Return the interval as text; empty if there is none."""
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    return f"{number(estimate.low)} – {number(estimate.high)}"


def estimate_text(estimate: Estimate | None) -> str:
    """Return a number with its interval as text."""
    if estimate is None:
        return "–"
    bounds = interval(estimate)
    return f"{number(estimate.value)} ({bounds})" if bounds else number(estimate.value)


def verdict(summary: Summary) -> list[str]:
    """Return sentences: where super-linear speed-up of the search is shown, is not, or is undecided; and cautions."""
    found = _verdicts(summary) if "target" in summary.parameters.goals else []
    return [*found, *_cautions(summary)]


def _verdicts(summary: Summary) -> list[str]:
    rows = [row for row in summary.rows if row.metric is STRONG_EVALUATIONS and row.comparison is not None]
    label = STRONG_EVALUATIONS.label[:1].upper() + STRONG_EVALUATIONS.label[1:]
    if not rows:
        return [f"{label}: cannot be told, since half of the runs, or more, did not reach the target."]
    told = []
    for kind in ("shown", "not shown", "undecided"):
        those = [row for row in rows if row.comparison is not None and row.comparison.verdict == kind]
        curves = groupby(those, key=lambda row: row.curve)
        places = [f"{curve.name} on {_sizes(of_curve)}" for curve, of_curve in curves if curve is not None]
        if places:
            told.append(f"{label}: super-linear speed-up is {kind}: {'; '.join(places)}.")
    return [*told, _CPU_IS_NO_SEARCH]


_CPU_IS_NO_SEARCH = (
    "Quotients of CPU times compare programs, their caches and their messages, not searches: above the number of nodes "
    "they are no super-linear speed-up of a search, and have no verdict."
)


def _sizes(rows: Iterable[Row]) -> str:
    return ", ".join(f"{row.nodes} nodes (efficiency {estimate_text(row.efficiency)}{_more(row)})" for row in rows)


def _more(row: Row) -> str:
    """Return how many seeds would decide, as text; empty if that is not known."""
    seeds = None if row.comparison is None else row.comparison.seeds
    return "" if seeds is None else f"; about {seeds:,} seeds would decide"


def _cautions(summary: Summary) -> list[str]:
    """Return what to keep in mind when reading the verdict."""
    found = []
    if summary.parameters.repeats < 10:
        found.append(
            f"With {summary.parameters.repeats} repeats intervals of medians are rough: they cannot reach beyond the "
            "extremes, and hold less often than 95 % (with 3 runs, 89 %)."
        )
    same, twins = summary.replayed
    if twins:
        found.append(f"{same} of {twins} lockstep runs were the same, bit for bit, as their twin in the simulator.")
    if summary.failed:
        found.append(f"{len(summary.failed)} runs failed and count nowhere; the same command makes them again.")
    return found
