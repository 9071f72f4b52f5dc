"""Write the files that are derived from the journal, and make the text that the command prints."""

import json
from collections.abc import Sequence
from pathlib import Path

from coordinator.experiments import tables
from coordinator.experiments.journal import Journal
from coordinator.experiments.plots import FORMATS, draw_all
from coordinator.experiments.report import write_report
from coordinator.experiments.statistics import Estimate
from coordinator.experiments.summary import (
    FITNESS,
    INDEPENDENT,
    PER_GENERATION,
    STRONG_EVALUATIONS,
    SUCCESS,
    TO_TARGET,
    Metric,
    Summary,
)
from coordinator.experiments.words import number, verdict
from problems import BadInput
from wire.plain import plain

_COLUMNS: tuple[tuple[str, Metric], ...] = (
    ("success", SUCCESS),
    ("s to target", TO_TARGET[0]),
    ("evaluations", TO_TARGET[1]),
    ("fitness", FITNESS),
    ("µs CPU/node/gen.", PER_GENERATION[2]),
    ("strong ×, eval.", STRONG_EVALUATIONS),
    ("n independent ×", INDEPENDENT),
)


def write_all(summary: Summary, journal: Journal, formats: Sequence[str] = FORMATS) -> None:
    """Write the tables, the pictures in these formats, and the report.

    Raises:
        BadInput: if they cannot be written.
    """
    folder = journal.folder
    try:
        tables.write_runs(summary, folder)
        tables.write_summary(summary, folder)
        pictures = draw_all(summary, folder, formats)
        write_report(summary, journal.experiment, pictures, folder / "report.html")
    except OSError as error:
        raise BadInput(f"{folder}: expected a folder that can be written, found {error.strerror}") from None


def as_json(summary: Summary, folder: Path) -> str:
    """Return the summary as one JSON object."""
    return json.dumps(
        {
            "directory": str(folder),
            "report": str(folder / "report.html"),
            "runs": len(summary.runs),
            "failed": len(summary.failed),
            "parameters": summary.parameters.to_json(),
            "replayed": {"identical": summary.replayed[0], "of": summary.replayed[1]},
            "sequential": [
                {
                    "deme": each.deme,
                    "success_rate": each.success.value,
                    "evaluations": _value(each.evaluations),
                    "cpu_seconds": _value(each.cpu_seconds),
                    "best_for": list(each.best_for),
                }
                for each in summary.sequential
            ],
            "summary": [tables.as_record(row) for row in summary.rows],
            "verdict": verdict(summary),
        },
        allow_nan=False,
    )


def _value(estimate: Estimate | None) -> float | None:
    return None if estimate is None else plain(estimate.value)


def as_words(summary: Summary, folder: Path) -> str:
    """Return a table of points, the verdict, and the path of the report, as text."""
    header = ["", "nodes", "deme", *(title for title, _ in _COLUMNS)]
    lines = [header, *_lines(summary)]
    return "\n".join([*_aligned(lines), "", *verdict(summary), f"report: {folder / 'report.html'}"])


def _lines(summary: Summary) -> list[list[str]]:
    lines = []
    for curve in summary.curves():
        for row in summary.find(SUCCESS, curve):
            found = [summary.find(metric, curve, row.nodes) for _, metric in _COLUMNS]
            texts = [number(each[0].estimate.value) if each else "–" for each in found]
            lines.append([curve.name, str(row.nodes), str(row.deme), *texts])
    return lines


def _aligned(lines: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(len(line[column]) for line in lines) for column in range(len(lines[0]))]
    return [
        "  ".join(
            text.ljust(width) if column == 0 else text.rjust(width)
            for column, (text, width) in enumerate(zip(line, widths, strict=True))
        )
        for line in lines
    ]
