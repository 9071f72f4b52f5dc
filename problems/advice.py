"""Hints for a run that has stalled: each names a setting, a value to try and the value that the run had."""

import re

from annotated_types import Le

from problems.run import DEFAULT_STALL, Run
from problems.tables import Table

_MOST_NODES = 1024  # no larger torus is suggested: each cell may be a process of its own
_MORE_DEMES = 4  # factor of the suggested deme size
_MORE_PATIENCE = 5  # factor of the suggested stall limit


def advice_on_run(run: Run) -> str:
    """Return a hint with options for a larger population and a longer stall limit, and the run's own values."""
    tried, used = [], []
    torus = re.fullmatch(r"torus (\d+)x(\d+)", run.topology)
    rows, columns = (int(side) for side in torus.groups()) if torus else (0, 0)
    if 0 < 4 * rows * columns <= _MOST_NODES:
        tried.append(f"--torus {2 * rows}x{2 * columns}")
        used.append(run.topology)
    patience = run.stall_limit() or DEFAULT_STALL
    tried += [f"--deme {_MORE_DEMES * run.deme}", f"--stall {_MORE_PATIENCE * patience}", "another --seed"]
    used += [f"deme {run.deme}", f"stall {patience}", f"seed {run.seed}"]
    return f"to search further, try {', '.join(tried[:-1])} or {tried[-1]} (this run: {', '.join(used)})"


def advice_on_length(problem: Table, field: str, value: int, why: str) -> list[str]:
    """Return a hint to allow longer solutions, as a list of one line; an empty list if the field is at its maximum.

    Args:
        problem: the problem, one of whose fields limits the length of a coded solution.
        field: the field's name in the problem file.
        value: the field's value, even if the file does not set it.
        why: what a longer solution can achieve, in words.
    """
    limits = [each.le for each in type(problem).model_fields[field].metadata if isinstance(each, Le)]
    more = min([2 * value, *(limit for limit in limits if isinstance(limit, int))])
    if more <= value:
        return []
    return [f"{why}: try {field} = {more} in the problem file (this run: {value})"]
