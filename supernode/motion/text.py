"""Write motions as tables of text for plotting and replay: CSV and JSON."""

import csv
import io
import json
from dataclasses import asdict

from problems.motion import Column, Motion


def as_csv(motion: Motion) -> str:
    """Return a line for each row, under names with units such as ``t [s]``; numbers keep full precision."""
    columns = list(motion.columns())
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_heading(column) for column in columns)
    writer.writerows(_rows(columns))
    return text.getvalue()


def as_json(motion: Motion, kind: str) -> str:
    """Return one JSON object: the kind, limits and notes of the motion, names and units of the columns, rows."""
    columns = list(motion.columns())
    table = {
        "kind": kind,
        "limits": [asdict(limit) for limit in motion.limits],
        "notes": motion.notes,
        "columns": [column.name for column in columns],
        "units": [column.unit for column in columns],
        "rows": _rows(columns),
    }
    return json.dumps(table) + "\n"


def _heading(column: Column) -> str:
    return f"{column.name} [{column.unit}]" if column.unit else column.name


def _rows(columns: list[Column]) -> list[tuple[float, ...]]:
    return list(zip(*(column.values.tolist() for column in columns), strict=True))
