"""Draw topologies: cells as dots; a rectangle of cells as it is, other topologies on a circle."""

import math
from typing import TYPE_CHECKING

from matplotlib.collections import LineCollection

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from topologies import Topology


def draw_topology(axes: "Axes", topology: "Topology", color: str = "tab:blue") -> float:
    """Draw links and cells, and return the size of a cell's dot in points."""
    places = [spot(topology, cell) for cell in range(topology.cells)]
    links = {(min(a, b), max(a, b)) for a, slots in enumerate(topology.table().tolist()) for b in slots if a != b}
    lines = LineCollection([_line(places[a], places[b], len(topology.place(a)) == 2) for a, b in sorted(links)])
    lines.set(color="0.6", linewidth=0.8)
    axes.add_collection(lines)
    size = max(1.0, 20.0 / math.sqrt(topology.cells))
    axes.plot(*zip(*places, strict=True), "o", color=color, markersize=size)
    axes.set_aspect("equal")
    axes.set_axis_off()
    return size


def spot(topology: "Topology", cell: int) -> tuple[float, float]:
    """Return where a cell is drawn."""
    place = topology.place(cell)
    if len(place) == 2:
        return float(place[1]), -float(place[0])
    angle = 2.0 * math.pi * cell / topology.cells
    return math.sin(angle), math.cos(angle)


def write_beside(axes: "Axes", text: str, place: tuple[float, float], size: float, color: str = "black") -> None:
    """Write ``text`` above a cell whose dot has that size."""
    offset = (0, max(3.0, size / 2))
    axes.annotate(text, place, offset, textcoords="offset points", ha="center", fontsize=7.5, color=color)


def _line(start: tuple[float, float], end: tuple[float, float], flat: bool) -> list[tuple[float, float]]:
    """Return a link's points: straight, or bent if it wraps round the torus, where it would hide the links between."""
    (x0, y0), (x1, y1) = start, end
    if not flat or math.hypot(x1 - x0, y1 - y0) < 2.0:
        return [start, end]
    bend = 0.12
    steps = [step / 16 for step in range(17)]
    return [
        (
            x0 + (x1 - x0) * step + (y1 - y0) * bend * math.sin(math.pi * step),
            y0 + (y1 - y0) * step - (x1 - x0) * bend * math.sin(math.pi * step),
        )
        for step in steps
    ]
