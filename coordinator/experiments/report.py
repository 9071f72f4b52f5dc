"""Write the report of an experiment: tables, pictures, and an explanation of how to read them."""

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coordinator.experiments import words
from coordinator.experiments.pages import rendered
from coordinator.experiments.plots import Picture
from coordinator.experiments.summary import (
    FITNESS,
    LAUNCH,
    MEMORY,
    PER_GENERATION,
    SPEEDUPS,
    SUCCESS,
    TO_TARGET,
    Metric,
    Summary,
)

_SECTIONS: tuple[tuple[str, tuple[str, ...], tuple[Metric, ...], tuple[str, ...]], ...] = (
    ("To the target", ("fixed-population", "growing-population"), (SUCCESS, *TO_TARGET), ("to-target", "success")),
    ("With a fixed budget", ("budget",), (FITNESS, SUCCESS), ("budget",)),
    (
        "What a generation costs",
        ("fixed-population", "growing-population", "budget"),
        PER_GENERATION,
        ("throughput", "cost-of-a-generation"),
    ),
)


@dataclass(frozen=True)
class _Cell:
    """A number in a table, its interval, and whether to highlight it."""

    text: str
    interval: str = ""
    marked: bool = False


@dataclass(frozen=True)
class _Table:
    """A header and rows; the first ``names`` columns are names, the others numbers."""

    header: list[str]
    rows: list[list[_Cell]]
    names: int


@dataclass(frozen=True)
class _Section:
    title: str
    tables: list[_Table]
    pictures: list[tuple[str, str]]  # data URL and caption


def write_report(
    summary: Summary, experiment: dict[str, Any], pictures: Sequence[tuple[bytes, Picture]], path: Path
) -> None:
    """Fill in the template and write the report to ``path``."""
    inlined = {picture.name: (_data_url(png), picture.caption) for png, picture in pictures}
    page = rendered(
        "coordinator.experiments",
        experiment=experiment,
        verdict=words.verdict(summary),
        critical_path=words.CRITICAL_PATH.format(cores=_cores(experiment["machine"]["cores"])),
        notions=[(metric.label, text) for metric, text in words.NOTIONS.items()],
        series=[_series(summary, name) for name in summary.parameters.series],
        sections=_sections(summary, inlined),
        runs=len(summary.runs),
        settings=json.dumps(experiment["parameters"], indent=2),
    )
    path.write_text(page, encoding="utf-8")


def _data_url(png: bytes) -> str:
    return "data:image/png;base64," + base64.b64encode(png).decode()


def _cores(count: int) -> str:
    return "one core" if count == 1 else f"{count} cores"


def _series(summary: Summary, name: str) -> str:
    parameters = summary.parameters
    return words.SERIES[name].format(population=f"{parameters.population:,}", budget=f"{parameters.budget:,}")


def _sections(summary: Summary, pictures: dict[str, tuple[str, str]]) -> list[_Section]:
    """Return the sections that have anything to show."""
    speed_ups = _Section("Speed-up", _speed_ups(summary), _chosen(pictures, "strong-speedup", "weak-speedup"))
    reference = _Section("The sequential algorithm", [_sequential(summary)], [])
    others = [
        _Section(title, [_points(summary, series, metrics)], _chosen(pictures, *names))
        for title, series, metrics, names in _SECTIONS
    ]
    sizes = _Section("What a size costs", [_sizes(summary)], _chosen(pictures, "size"))
    return [
        section for section in (speed_ups, *others, sizes, reference) if any(table.rows for table in section.tables)
    ]


def _chosen(pictures: dict[str, tuple[str, str]], *names: str) -> list[tuple[str, str]]:
    return [pictures[name] for name in names if name in pictures]


def _points(summary: Summary, series: Sequence[str], metrics: Sequence[Metric]) -> _Table:
    """Return a table with a row for each point, and a column for each metric that any point has."""
    curves = summary.curves(*series)
    shown = [metric for metric in metrics if any(summary.find(metric, curve) for curve in curves)]
    rows = [
        [_Cell(curve.name), _Cell(str(base.nodes)), _Cell(str(base.deme))]
        + [_value(summary, metric, curve, base.nodes) for metric in shown]
        for curve in curves
        for base in summary.find(SUCCESS, curve)
    ]
    return _Table(["series", "nodes", "deme", *map(_title, shown)], rows, 3)


def _value(summary: Summary, metric: Metric, curve: Any, nodes: int) -> _Cell:
    found = summary.find(metric, curve, nodes)
    if not found:
        return _Cell("–")
    row = found[0]
    return _Cell(words.number(row.estimate.value), words.interval(row.estimate), row.is_super_linear)


def _title(metric: Metric) -> str:
    unit = f", {metric.unit}" if metric.unit not in ("", "×") else ""
    return f"{metric.label}{unit} ({metric.statistic})" if metric is not SUCCESS else metric.label


def _speed_ups(summary: Summary) -> list[_Table]:
    """Return a table for each kind of speed-up, with the speed-ups and efficiencies of all points."""
    found = []
    for metric in SPEEDUPS:
        rows = [
            [
                _Cell(curve.name),
                _Cell(str(row.nodes)),
                _Cell(str(row.deme)),
                _Cell(words.number(row.estimate.value), words.interval(row.estimate), row.is_super_linear),
                _Cell(words.number(row.efficiency.value), words.interval(row.efficiency), row.is_super_linear),
            ]
            for curve in summary.curves("fixed-population", "growing-population")
            for row in summary.find(metric, curve)
        ]
        if rows:
            found.append(_Table(["series", "nodes", "deme", metric.label, "efficiency"], rows, 3))
    return found


def _sizes(summary: Summary) -> _Table:
    metrics = [metric for metric in (LAUNCH, MEMORY) if summary.find(metric)]
    rows = [
        [_Cell(str(nodes)), *(_value(summary, metric, None, nodes) for metric in metrics)]
        for nodes in summary.parameters.nodes
        if any(summary.find(metric, None, nodes) for metric in metrics)
    ]
    return _Table(["nodes", *map(_title, metrics)], rows, 1)


def _sequential(summary: Summary) -> _Table:
    header = [
        "deme",
        "reached the target",
        "evaluations (median)",
        "CPU time, s (median)",
        "fitness with the budget",
        "best in",
    ]
    rows = [
        [
            _Cell(str(each.deme)),
            *(
                _Cell("–") if estimate is None else _Cell(words.number(estimate.value), words.interval(estimate))
                for estimate in (each.success, each.evaluations, each.cpu_seconds, each.fitness)
            ),
            _Cell(" and ".join(each.best_for) or "–", "", bool(each.best_for)),
        ]
        for each in summary.sequential
    ]
    return _Table(header, rows, 1)
