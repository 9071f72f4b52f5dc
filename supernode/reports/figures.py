"""Draw the figures of a job's report: small SVGs in the colour of the page's text, for light and dark pages."""

import io
import itertools
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import matplotlib as mpl
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from supernode.pictures.topology_picture import draw_topology, spot, write_beside
from topologies import Topology

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Record = Mapping[str, Any]

_INK = "#123456"  # a placeholder, which `_svg` replaces by the colour of the page's text
_COLORS = {"verified": "#0c9b6e", "best": "#2f8fd0", "median": "#d99200", "worst": "#d9603b"}
_SIZE = (4.6, 3.1)  # inches: as wide as a phone, so that the text is not scaled down there
_ARROWS = 40  # arrows drawn of a lineage, the last ones: more would hide each other
_NAMED = 3  # births listed at a cell


class Picture(NamedTuple):
    """A figure of the report."""

    svg: Markup
    caption: str


@dataclass(frozen=True)
class History:
    """What the cluster keeps of a job.

    Attributes:
        improvements: the records "improvements": what the spy received, and when.
        births: the improvements of each epoch as its cells recorded them; where nothing is recorded, such as in an
            epoch that has not ended, as the spy received them.
        statistics: the records "statistics".
        began: when the job began to run, Unix time, s.
    """

    improvements: Sequence[Record]
    births: Sequence[Record]
    statistics: Sequence[Record]
    began: float


def pictures(history: History, topology: Topology) -> list[Picture]:
    """Return the figures for which there are records."""
    found = []
    if history.improvements or history.statistics:
        found += [_against_seconds(history), _against_generations(history)]
    if history.statistics:
        found += [_diversity(history), _messages(history)]
    if history.births:
        found.append(_lineage(history.births, topology))
    return found


def _against_seconds(history: History) -> Picture:
    figure, axes = _empty("seconds since the start", "fitness")
    epochs = _epochs(history.improvements)
    end = max(each["at"] for each in (*history.improvements, *history.statistics))
    for epoch, until in zip(epochs, [*(after[0]["at"] for after in epochs[1:]), end], strict=False):
        _steps(axes, [each["at"] - history.began for each in epoch], epoch, until - history.began)
    _curves(axes, [each["at"] - history.began for each in history.statistics], history.statistics)
    return _finished(
        figure,
        "convergence-seconds",
        "Convergence: each verified improvement as a step at the time when the spy received it; and the best, the "
        "median and the worst of all individuals, sampled each second. Infeasible individuals have no fitness to show.",
    )


def _against_generations(history: History) -> Picture:
    figure, axes = _empty("generation of its epoch", "fitness")
    lives = _lives(history.statistics)
    for epoch in _epochs(history.births):
        generations = [each["generation"] for each in epoch]
        last = max((each["generation"] for each in lives[-1]), default=0) if lives else 0
        is_last = epoch[-1] is history.births[-1]
        _steps(axes, generations, epoch, max(generations[-1], last) if is_last else generations[-1], "best so far")
    for life in lives:
        _curves(axes, [each["generation"] for each in life], life)
    return _finished(
        figure,
        "convergence-generations",
        "The same against generations: an improvement at the generation of its birth, as the cells recorded it where "
        "an epoch has ended; a sample at the root's generation. Each epoch of a job counts its own generations from 0.",
    )


def _diversity(history: History) -> Picture:
    figure, axes = _empty("seconds since the start", "diversity")
    _line(axes, history, [each["diversity"] for each in history.statistics])
    axes.set_ylim(-0.03, 1.03)
    return _finished(
        figure,
        "diversity",
        "Diversity: how many of the nodes' best genomes differ, as a share of the nodes; 1: no two are alike.",
    )


def _messages(history: History) -> Picture:
    figure, axes = _empty("seconds since the start", "messages a second")
    _line(axes, history, _rates(history.statistics))
    axes.set_ylim(bottom=0)
    return _finished(
        figure,
        "messages",
        "Messages between neighbours per second, of all nodes together, from one sample to the next.",
    )


def _lineage(improvements: Sequence[Record], topology: Topology) -> Picture:
    figure = Figure(figsize=(_SIZE[0], _SIZE[0]), layout="constrained")
    axes = figure.add_subplot()
    size = draw_topology(axes, topology, "0.6")
    births = [each["cell"] for each in improvements]
    shades = mpl.colormaps["viridis"]
    for number, (here, there) in enumerate(itertools.pairwise(births)):
        if here != there and number >= len(births) - 1 - _ARROWS:
            shade = shades(0.3 + 0.6 * number / len(births))
            style = {"arrowstyle": "-|>", "color": shade, "connectionstyle": "arc3,rad=0.18", "linewidth": 1.4}
            axes.annotate("", spot(topology, there), spot(topology, here), arrowprops=style)
    for cell in sorted(set(births)):
        last = cell == births[-1]
        mark, color, wide = ("*", _COLORS["worst"], size + 9) if last else ("o", _COLORS["verified"], size + 2)
        axes.plot(*spot(topology, cell), mark, color=color, markersize=wide)
        numbers = [number for number, birth in enumerate(births, 1) if birth == cell]
        write_beside(axes, _named(numbers), spot(topology, cell), wide + 4, _INK)
    axes.margins(0.12)
    return _finished(
        figure,
        "lineage",
        f"The champion's lineage on {topology.spec}: where the improvements were born, numbered in their order; the "
        f"star is the last one's cell. Arrows lead from each to the next{_of_the_last(len(births))}.",
    )


def _of_the_last(births: int) -> str:
    return f" (of the last {_ARROWS})" if births > _ARROWS + 1 else ""


def _named(numbers: Sequence[int]) -> str:
    """Return the numbers as text; of many, the first two and the last."""
    if len(numbers) <= _NAMED:
        return ", ".join(map(str, numbers))
    return f"{numbers[0]}, {numbers[1]} … {numbers[-1]}"


# What records hold ----------------------------------------------------------------------------------------------------
def _epochs(improvements: Sequence[Record]) -> list[list[Record]]:
    """Return the improvements grouped by epoch."""
    return [list(epoch) for _, epoch in itertools.groupby(improvements, lambda each: each["epoch"])]


def _lives(statistics: Sequence[Record]) -> list[list[Record]]:
    """Return the samples grouped by epoch; a job that lost its state runs an epoch again, as a group of its own."""
    lives: list[list[Record]] = []
    for each in statistics:
        before = lives[-1][-1] if lives else each
        if not lives or each["epoch"] != before["epoch"] or each["generation"] < before["generation"]:
            lives.append([])
        lives[-1].append(each)
    return lives


def _rates(statistics: Sequence[Record]) -> list[float]:
    """Return messages per second before each sample; NaN for the first, and where the nodes' counters restarted."""
    rates = [math.nan]
    for before, after in itertools.pairwise(statistics):
        messages, seconds = after["messages"] - before["messages"], after["at"] - before["at"]
        rates.append(messages / seconds if messages >= 0 and seconds > 0 else math.nan)
    return rates


def _fitness(value: float | None) -> float:
    return math.nan if value is None else value


# Axes -----------------------------------------------------------------------------------------------------------------
def _empty(along: str, up: str) -> tuple[Figure, "Axes"]:
    figure = Figure(figsize=_SIZE, layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(along)
    axes.set_ylabel(up)
    axes.grid(True, color=_INK, alpha=0.13, linewidth=0.8)
    axes.spines[["top", "right"]].set_visible(False)
    for label in (axes.xaxis.label, axes.yaxis.label):
        label.set_color(_INK)
    axes.spines[:].set_color(_INK)
    axes.tick_params(which="both", colors=_INK)
    return figure, axes


def _steps(axes: "Axes", along: list[float], epoch: Sequence[Record], last: float, label: str = "verified") -> None:
    up = [_fitness(each["fitness"]) for each in epoch]
    axes.step([*along, last], [*up, up[-1]], where="post", color=_COLORS["verified"], linewidth=1.8, label=label)


def _curves(axes: "Axes", along: list[float], samples: Sequence[Record]) -> None:
    for name in ("best", "median", "worst"):
        up = [_fitness(each[name]) for each in samples]
        axes.plot(along, up, color=_COLORS[name], linewidth=1.2, marker=_marker(samples), markersize=3, label=name)


def _line(axes: "Axes", history: History, up: Sequence[float]) -> None:
    along = [each["at"] - history.began for each in history.statistics]
    axes.plot(along, up, color=_COLORS["best"], linewidth=1.4, marker=_marker(up), markersize=3)


def _marker(samples: Sequence[object]) -> str:
    """Return a marker for few samples, which a line alone would not show."""
    return "o" if len(samples) < 30 else ""


def _finished(figure: Figure, name: str, caption: str) -> Picture:
    for axes in figure.axes:
        handles = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        if handles:
            _scale(axes)
            figure.legend(
                list(handles.values()),
                list(handles),
                loc="outside upper center",
                ncols=len(handles),
                frameon=False,
                labelcolor=_INK,
                fontsize=9,
            )
    return Picture(_svg(figure, name, caption), caption)


def _scale(axes: "Axes") -> None:
    """Use a logarithmic axis if the fitness spans more than two decades; one linear near 0 if it reaches 0."""
    values = [y for line in axes.lines for y in map(float, line.get_ydata()) if math.isfinite(y)]  # type: ignore[arg-type]
    positive = [value for value in values if value > 0]
    if positive and min(values) >= 0 and max(positive) > 100 * min(positive):
        if min(values) > 0:
            axes.set_yscale("log")
        else:
            axes.set_yscale("symlog", linthresh=min(positive))


def _svg(figure: Figure, name: str, caption: str) -> Markup:
    """Return the figure as SVG that can stand in a page beside others; text stays text."""
    text = io.StringIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    # The salt makes ids, and so the whole page, the same each time.
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(text, format="svg", transparent=True, metadata=nothing)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :].replace(_INK, "currentColor")
    svg = re.sub(r'( id="|url\(#|href="#)', rf"\g<1>{name}-", svg)  # ids must be unique within the page
    return Markup(svg.replace("<svg", f'<svg role="img" aria-label="{escape(caption)}"', 1))
