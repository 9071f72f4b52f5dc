"""Draw the pictures of an experiment: curves over the number of nodes, with intervals and the ideal if there is one."""

import io
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from coordinator.experiments.summary import (
    FITNESS,
    INDEPENDENT,
    LAUNCH,
    MEMORY,
    PER_GENERATION,
    STRONG_CPU,
    STRONG_EVALUATIONS,
    SUCCESS,
    TO_TARGET,
    WEAK_BALANCE,
    WEAK_TWIN,
    Curve,
    Metric,
    Row,
    Summary,
)

FORMATS = ("png", "svg")
"""The formats of pictures by default; PDF is possible too."""

_TITLE = 48  # characters in a line of a title, which is as wide as its plot
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # safe for colour-blind readers
_MARKERS = {"lockstep": "o", "async": "s"}
_LINES = {"lockstep": "-", "async": "--"}
_DODGE = 1.035  # factor between the positions of two curves, so that error bars do not cover each other
_LEAST_SPAN = 6.0  # least ratio of the ends of a logarithmic axis
_TO_TARGET = ("fixed-population", "growing-population")


@dataclass(frozen=True)
class _Panel:
    """One pair of axes: a metric of some series, or of sizes if ``series`` is empty; ``ideal`` is for so many nodes."""

    metric: Metric
    series: tuple[str, ...]
    ideal: Callable[[int], float] | None = None
    logarithmic: bool = True


@dataclass(frozen=True)
class Picture:
    """A picture: the name of its file without the extension, its caption, and its panels."""

    name: str
    caption: str
    panels: tuple[_Panel, ...] = field(repr=False)


def _itself(nodes: int) -> float:
    return float(nodes)


_ALL = ("fixed-population", "growing-population", "budget")
_PICTURES = (
    Picture(
        "strong-speedup",
        "Strong speed-up: against the best sequential algorithm, in evaluations; in the middle what n independent runs "
        "of that make; right the same programs in critical-path CPU time, which is no speed-up of a search. Grey: "
        "ideal, one node's worth from each node; above it, super-linear.",
        (
            _Panel(STRONG_EVALUATIONS, _TO_TARGET, _itself),
            _Panel(INDEPENDENT, _TO_TARGET, _itself),
            _Panel(STRONG_CPU, _TO_TARGET, _itself),
        ),
    ),
    Picture(
        "weak-speedup",
        "What a processor costs: the same n-cell algorithm on one, against its critical-path CPU time on n nodes. "
        "Left the one processor simulates it without messages; right it does all that the nodes did. Grey: ideal.",
        (_Panel(WEAK_TWIN, _TO_TARGET, _itself), _Panel(WEAK_BALANCE, _TO_TARGET, _itself)),
    ),
    Picture(
        "to-target",
        "What it takes to reach the target: medians over the runs that reached it. Critical-path CPU time is that of "
        "the node that used most, to the agreed stop.",
        tuple(_Panel(TO_TARGET[index], _TO_TARGET) for index in (0, 1, 3)),
    ),
    Picture(
        "success",
        "Runs that reached the target, with Wilson's intervals: left within the limit of evaluations, right within the "
        "budget.",
        (_Panel(SUCCESS, _TO_TARGET, None, False), _Panel(SUCCESS, ("budget",), None, False)),
    ),
    Picture(
        "budget",
        "Fixed budget: the best fitness (lower is better) after the same number of evaluations of all nodes together.",
        (_Panel(FITNESS, ("budget",), None, False),),
    ),
    Picture(
        "throughput",
        "Generations and evaluations in a second on this machine, whose cores the nodes share.",
        (_Panel(PER_GENERATION[0], _ALL), _Panel(PER_GENERATION[1], _ALL)),
    ),
    Picture(
        "cost-of-a-generation",
        "What a generation costs a node: CPU time for everything (breeding, evaluations, messages); and messages "
        "received.",
        (_Panel(PER_GENERATION[2], _ALL), _Panel(PER_GENERATION[4], _ALL, None, False)),
    ),
    Picture(
        "size",
        "What a size costs, whatever runs on it: from the call to the ready cluster, and memory of a node (PSS).",
        (_Panel(LAUNCH, ()), _Panel(MEMORY, (), None, False)),
    ),
)


def draw_all(summary: Summary, folder: Path, formats: Sequence[str] = FORMATS) -> list[tuple[bytes, Picture]]:
    """Draw every picture for which there are numbers, in each of the formats; return the pictures as PNG too."""
    drawn = []
    for picture in _PICTURES:
        panels = [panel for panel in picture.panels if _curves(summary, panel)]
        if panels:
            figure, shown = _draw(summary, panels), io.BytesIO()
            for kind in formats:
                figure.savefig(folder / f"{picture.name}.{kind}", dpi=130)
            figure.savefig(shown, dpi=130)
            drawn.append((shown.getvalue(), picture))
    return drawn


def _curves(summary: Summary, panel: _Panel) -> list[tuple[Curve | None, list[Row]]]:
    """Return the curves of a panel that have finite numbers; the curve of sizes is None."""
    wanted: Sequence[Curve | None] = summary.curves(*panel.series) if panel.series else [None]
    found = [(curve, summary.find(panel.metric, curve)) for curve in wanted]
    return [(curve, rows) for curve, rows in found if any(row.estimate.value < float("inf") for row in rows)]


def _draw(summary: Summary, panels: Sequence[_Panel]) -> Figure:
    figure = Figure(figsize=(0.6 + 4.6 * len(panels), 4.4), layout="constrained")
    figure.set_facecolor("white")
    all_axes = figure.subplots(1, len(panels), squeeze=False)[0]
    for axes, panel in zip(all_axes, panels, strict=True):
        _draw_panel(axes, summary, panel)
    handles: dict[str, Any] = {
        label: handle for axes in all_axes for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    handles |= {"ideal": handles.pop("ideal")} if "ideal" in handles else {}  # last
    if len(handles) > 1:
        figure.legend(
            handles.values(), handles.keys(), loc="outside lower center", ncols=min(4, len(handles)), frameon=False
        )
    return figure


def _draw_panel(axes: Any, summary: Summary, panel: _Panel) -> None:
    curves = _curves(summary, panel)
    styles = {curve: index for index, curve in enumerate(summary.curves())}
    for index, (curve, rows) in enumerate(curves):
        _draw_curve(axes, curve, rows, _color(curve, styles), _DODGE ** (index - (len(curves) - 1) / 2))
    _frame(axes, summary.parameters.nodes, panel)
    if panel.ideal is not None:
        nodes = summary.parameters.nodes
        axes.plot(
            nodes, [panel.ideal(each) for each in nodes], color="0.6", linewidth=4, alpha=0.5, zorder=0, label="ideal"
        )


def _color(curve: Curve | None, styles: dict[Curve, int]) -> str:
    """Return a curve's colour, which depends on its series and deme; markers and lines show the mode."""
    families = list(dict.fromkeys((each.series, each.deme) for each in styles))
    place = 0 if curve is None else families.index((curve.series, curve.deme))
    return _COLORS[place % len(_COLORS)]


def _draw_curve(axes: Any, curve: Curve | None, rows: Iterable[Row], color: str, dodge: float) -> None:
    shown = [row for row in rows if row.estimate.value < float("inf")]
    mode = "lockstep" if curve is None else curve.mode
    axes.errorbar(
        [row.nodes * dodge for row in shown],
        [row.estimate.value for row in shown],
        yerr=[[_reach(row, down) for row in shown] for down in (True, False)],
        color=color,
        marker=_MARKERS[mode],
        markerfacecolor=color if mode == "lockstep" else "white",
        linestyle=_LINES[mode],
        markersize=6,
        linewidth=1.5,
        elinewidth=1.2,
        capsize=3,
        label=None if curve is None else curve.name,
    )


def _reach(row: Row, down: bool) -> float:
    """Return the length of an error bar, at most up to ten times the value: the bound may be infinite."""
    bound = row.estimate.low if down else row.estimate.high
    value = row.estimate.value
    if bound is None:
        return 0.0
    return max(0.0, value - bound if down else min(bound, 10 * value) - value)


def _frame(axes: Any, nodes: Sequence[int], panel: _Panel) -> None:
    """Set up the axes: scales, ticks at the numbers of nodes, title and unit."""
    metric = panel.metric
    axes.set_xscale("log", base=2)
    axes.set_xticks(nodes, [str(each) for each in nodes])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.set_xlim(nodes[0] / 1.35, nodes[-1] * 1.35)
    axes.set_xlabel("nodes")
    unit = f" ({metric.unit})" if metric.unit not in ("", "×") else ""
    axes.set_title(fill(f"{metric.label}{unit}", _TITLE), fontsize=10.5)
    if panel.logarithmic:
        axes.set_yscale("log")
        _ticks(axes)
    else:
        _from_zero(axes)
    if metric is SUCCESS:
        axes.set_ylim(-0.03, 1.03)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.0%}"))
    axes.grid(True, which="major", color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def _from_zero(axes: Any) -> None:
    """Begin a linear axis at zero, with room for a marker there; leave an axis that reaches far below zero."""
    low, high = axes.get_ylim()
    if low >= -0.1 * high:
        axes.set_ylim(-0.03 * high, 1.05 * high)


def _ticks(axes: Any) -> None:
    """Put plain numbers on a logarithmic axis: 1, 2 and 5 of each decade if there are few decades, else powers of 10.

    An axis spans at least a factor of `_LEAST_SPAN`, so that a small difference looks small.
    """
    low, high = axes.get_ylim()
    if high / low < _LEAST_SPAN:
        widen = (_LEAST_SPAN * low / high) ** 0.5
        low, high = low / widen, high * widen
        axes.set_ylim(low, high)
    few = high / low < 100
    axes.yaxis.set_major_locator(FixedLocator(_round_numbers(low, high, (1, 2, 5) if few else (1,))))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,g}"))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.set_ylim(low, high)


def _round_numbers(low: float, high: float, steps: Sequence[int]) -> list[float]:
    """Return the multiples ``steps`` of powers of ten between ``low`` and ``high``."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    return [value for decade in decades for step in steps if low <= (value := float(f"{step}e{decade}")) <= high]
