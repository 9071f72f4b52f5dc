"""Say what a trial has shown, in words or as JSON."""

import statistics
from collections import Counter
from typing import Any

from supernode.chaos.trial import Outcome

_MOST = 0.95


def as_json(outcome: Outcome) -> dict[str, Any]:
    """Return the outcome as plain values."""
    result, times = outcome.result, outcome.whole_again
    return {
        "faults": [
            {"at": at, "do": fault.do, "process": fault.target, "seconds": fault.seconds} for at, fault in outcome.done
        ],
        "lost": outcome.lost,
        "status": None if result is None else result.status,
        "generations": None if result is None else result.generations,
        "fitness": None if result is None else result.fitness,
        "history_sha256": None if result is None else result.history_sha256,
        "repeats": outcome.repeats,
        "directives": [] if result is None else result.directives,
        "whole_again": times,
        "stood_still": outcome.stood_still,
        "bred_apart": outcome.bred_apart,
    }


def in_words(outcome: Outcome) -> str:
    """Return the outcome in a few lines."""
    result, times = outcome.result, outcome.whole_again
    counts = Counter(f"{fault.do} {fault.kind}" for _, fault in outcome.done)
    lines = ["done: " + (", ".join(f"{each} ({count})" for each, count in sorted(counts.items())) or "nothing")]
    if times:
        latest = times[int(_MOST * (len(times) - 1))]
        middle = statistics.median(times)
        lines.append(f"{len(times)} dead cells went on exactly: after {middle:.2f} s (median), {latest:.2f} s (95 %)")
    if result is not None:
        new_epochs = sum(each["do"] in ("replace", "resume", "restart") for each in result.directives)
        lines.append(f"{result.status} after {result.generations:,} generations, fitness {result.fitness:.6g}")
        lines.append(f"epochs that began because cells could not go on exactly: {new_epochs}")
    if outcome.stood_still is not None:
        lines.append(f"the longest time without news of a new generation: {outcome.stood_still:.1f} s")
    if outcome.bred_apart:
        most = max(outcome.bred_apart)
        lines.append(f"while a host was cut off for long, the others bred at most {most:,} generations")
    if outcome.repeats:
        lines.append("a replay in one process has the same history, bit for bit")
    lines += [f"lost: {each}" for each in outcome.lost] or ["lost: nothing"]
    return "\n".join(lines)
