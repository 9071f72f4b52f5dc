"""Write runs and summary as tables, Parquet and CSV, for further computations."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from coordinator.experiments.statistics import Estimate
from coordinator.experiments.summary import SPEEDUPS, Row, Summary
from wire.plain import plain

_ROLES = {"nodes": 0, "twin": 1, "sequential": 2}


def write_runs(summary: Summary, folder: Path) -> None:
    """Write ``runs.parquet`` and ``runs.csv``, one row for each run."""
    if not summary.runs:
        return
    names = [name for name in summary.runs[0] if name != "type"]
    ordered = sorted(summary.runs, key=lambda run: (_ROLES[run["role"]], run["nodes"], run["key"]))
    table = pa.table({name: _column([run.get(name) for run in ordered]) for name in names})
    pyarrow.parquet.write_table(table, folder / "runs.parquet")
    pyarrow.csv.write_csv(table, folder / "runs.csv")


def write_summary(summary: Summary, folder: Path) -> None:
    """Write ``summary.csv``, one row for each number, with its interval."""
    rows = [as_record(row) for row in summary.rows]
    if rows:
        table = pa.table({name: _column([row[name] for row in rows]) for name in rows[0]})
        pyarrow.csv.write_csv(table, folder / "summary.csv")


def as_record(row: Row) -> dict[str, Any]:
    """Return a number with its point, metric and interval, as plain values; infinite values become None."""
    curve = row.curve
    speed_up = row.metric in SPEEDUPS
    return {
        "series": None if curve is None else curve.series,
        "mode": None if curve is None else curve.mode,
        "nodes": row.nodes,
        "deme": row.deme,
        "metric": row.metric.name,
        "statistic": row.metric.statistic,
        "unit": row.metric.unit or None,
        **_numbers(row.estimate),
        "runs": row.estimate.count,
        "efficiency": plain(row.efficiency.value) if speed_up else None,
        "super_linear": row.is_super_linear if speed_up else None,
        "verdict": None if row.comparison is None else row.comparison.verdict,
        "seeds_to_decide": None if row.comparison is None else row.comparison.seeds,
    }


def _numbers(estimate: Estimate) -> dict[str, float | None]:
    return {"value": plain(estimate.value), "low": plain(estimate.low), "high": plain(estimate.high)}


def _column(values: list[Any]) -> Any:
    """Return a column of one type: integers among floats become floats, and a column without values is text."""
    present = [value for value in values if value is not None]
    if not present:
        return pa.array(values, pa.string())
    if any(isinstance(value, float) for value in present):
        return pa.array([None if value is None else float(value) for value in values], pa.float64())
    return pa.array(values)
