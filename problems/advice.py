"""Advises what to turn when a run has stalled: each setting with a value to try, and the one that the run had."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

from annotated_types import Le

from problems.run import DEFAULT_STALL, Run

if TYPE_CHECKING:
    from problems.problem import Problem

_MOST_NODES = 1024  # that a machine is asked to hold unasked
_MORE_DEMES = 4
_MORE_PATIENCE = 5


class _Length(NamedTuple):
    """The field of a kind that says how long a coded solution may be.

    Attributes:
        field: in the problem file.
        value: the attribute that has its value, also where the file leaves it open.
        why: what a longer one may do.
    """

    field: str
    value: str
    why: str


_LENGTHS = {
    "arm-path": _Length("rounds", "rounds", "a way around more corners takes more moves"),
    "mobile-robot": _Length("commands", "pairs", "a way with more turns takes more commands"),
    "sphere-path": _Length("nodes", "nodes", "a way around more obstacles takes more nodes"),
    "terrain": _Length("blocks", "blocks", "a way with more turns takes more blocks"),
}


def advice_on_run(run: Run) -> str:
    """Larger populations and more patience, as options; with what the run had."""
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


def advice_on_length(problem: Problem) -> str | None:
    """A longer coded solution, for kinds that have such a field; None for others, or if it is the longest already."""
    length = _LENGTHS.get(problem.kind)
    value = None if length is None else getattr(problem, length.value, None)
    if length is None or value is None:
        return None
    limits = [each.le for each in type(problem).model_fields[length.field].metadata if isinstance(each, Le)]
    more = min([2 * value, *(limit for limit in limits if isinstance(limit, int))])
    if more <= value:
        return None
    return f"{length.why}: try {length.field} = {more} in the problem file (this run: {value})"
