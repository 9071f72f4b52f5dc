"""Numbers as people read them, and what can be concluded, in plain words: for the terminal and for the report."""

import math
from collections.abc import Iterable
from itertools import groupby

from coordinator.scaling.statistics import Estimate
from coordinator.scaling.summary import (
    STRONG_CPU,
    STRONG_EVALUATIONS,
    WEAK_BALANCE,
    WEAK_TWIN,
    Metric,
    Row,
    Summary,
)

NOTIONS = {
    STRONG_EVALUATIONS: (
        "The median evaluations to the target of the best sequential algorithm of this project, divided by the median "
        "evaluations of one of the n nodes (those of all nodes, divided by n). It compares the searches and knows no "
        "messages. A run that did not reach the target counts as dearer than any that did."
    ),
    STRONG_CPU: (
        "The median CPU time of the best sequential algorithm, in one process without messages, divided by the median "
        "critical-path CPU time on n nodes, with all that messages cost them."
    ),
    WEAK_TWIN: (
        "Orthodox: the CPU time of the same n-cell run, bit for bit, by the simulator on one processor and "
        "without messages, divided by the critical-path CPU time on n nodes; run by run. In lockstep only, where "
        "such a twin exists. In evaluations it is n by definition, so that is not shown."
    ),
    WEAK_BALANCE: (
        "The CPU time of all n nodes, divided by the critical-path CPU time. It tells how evenly the work is spread. "
        "Work that only messages cause is on both sides, and it cannot exceed n."
    ),
}
"""What each speed-up means; every one that is shown is named so."""

CRITICAL_PATH = (
    "Critical-path CPU time is the CPU time of the node process that used most in a run, without what preparing a job "
    "costs it. A machine with a core for every node would need at least about that long. It is no forecast of a time: "
    "waiting for messages and neighbours is not in it, and it was measured on processes that shared {cores}."
)

SERIES = {
    "strong": "Strong scaling: a population of {population} in all, divided among the nodes; run to the target.",
    "weak": "Weak scaling: the deme on each node is fixed, so the population grows with the nodes; run to the target.",
    "budget": "Fixed budget: the deme on each node is fixed, and all nodes together make at most {budget} evaluations; "
    "the best fitness reached is compared.",
}


def number(value: float) -> str:
    """Three figures, or all of a whole part."""
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
    """The interval alone, or nothing."""
    if estimate is None or estimate.low is None or estimate.high is None:
        return ""
    return f"{number(estimate.low)} – {number(estimate.high)}"


def estimate_text(estimate: Estimate | None) -> str:
    """A number with its interval."""
    if estimate is None:
        return "–"
    bounds = interval(estimate)
    return f"{number(estimate.value)} ({bounds})" if bounds else number(estimate.value)


def verdict(summary: Summary) -> list[str]:
    """Whether super-linear speed-up was observed, of each notion that could show it; and what else to know."""
    metrics: list[Metric] = []
    if "target" in summary.parameters.goals:
        metrics += [STRONG_EVALUATIONS, STRONG_CPU]
        metrics += [WEAK_TWIN] if summary.replayed[1] else []
    return [*(_verdict_of(summary, metric) for metric in metrics), *_cautions(summary)]


def _verdict_of(summary: Summary, metric: Metric) -> str:
    rows = [row for row in summary.super_linear() if row.metric is metric]
    label = metric.label[:1].upper() + metric.label[1:]
    if not any(row.metric is metric for row in summary.rows):
        return f"{label}: cannot be told, since half of the runs, or more, did not reach the target."
    if not rows:
        return f"{label}: no super-linear speed-up was observed (no interval of an efficiency lies wholly above 1)."
    curves = groupby(rows, key=lambda row: row.curve)
    places = [f"{curve.name} on {_sizes(those)}" for curve, those in curves if curve is not None]
    return f"{label}: super-linear speed-up was observed: {'; '.join(places)}."


def _sizes(rows: Iterable[Row]) -> str:
    return ", ".join(f"{row.nodes} nodes (efficiency {estimate_text(row.efficiency)})" for row in rows)


def _cautions(summary: Summary) -> list[str]:
    """What to keep in mind when reading the verdict."""
    found = []
    if summary.parameters.repeats < 10:
        found.append(
            f"With {summary.parameters.repeats} repeats intervals of medians are rough: they cannot reach beyond the "
            "extremes, and hold less often than 95 %."
        )
    same, twins = summary.replayed
    if twins:
        found.append(f"{same} of {twins} lockstep runs were the same, bit for bit, as their twin in the simulator.")
    if summary.failed:
        found.append(f"{len(summary.failed)} runs failed and count nowhere; the same command makes them again.")
    return found
