"""What a topology is: how many cells, how many neighbours each has, how far news has to go; and a drawing."""

import argparse
import json
import math
from typing import TYPE_CHECKING

from supernode import exits

if TYPE_CHECKING:
    from topologies import Topology

EXAMPLE = 'supernode topology "small-world 64 4 0.1 seed 1" --plot small-world.svg'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which one, and where to draw it."""
    parser.add_argument("spec", metavar="SPEC", help='such as "torus 4x4", "ring 16" or "hypercube 4"')
    parser.add_argument("--plot", metavar="FILE", help="draw it: PNG, SVG or PDF, by the name's end")
    parser.add_argument("--json", action="store_true", help="print one JSON object, with the neighbours of each cell")


def run(options: argparse.Namespace) -> int:
    """Print the figures, and draw."""
    import topologies
    from problems import BadInput
    from supernode.picture import check_picture_name

    if options.plot is not None:
        check_picture_name(options.plot)
    try:
        topology = topologies.parse(options.spec)
    except ValueError as error:
        raise BadInput(f"SPEC: {error}") from error
    print(json.dumps(_facts(topology)) if options.json else _words(topology))
    if options.plot is not None:
        _draw(topology, options.plot)
    return exits.OK


def _degrees(topology: "Topology") -> tuple[int, int]:
    """The fewest and the most other cells that a cell is linked with."""
    counts = [len({*slots} - {cell}) for cell, slots in enumerate(topology.table().tolist())]
    return min(counts), max(counts)


def _facts(topology: "Topology") -> dict[str, object]:
    least, most = _degrees(topology)
    return {
        "topology": topology.spec,
        "cells": topology.cells,
        "degree": [least, most],
        "diameter": topology.diameter,
        "neighbours": topology.table().tolist(),
    }


def _words(topology: "Topology") -> str:
    least, most = _degrees(topology)
    degree = str(least) if least == most else f"{least} to {most}"
    return f"{topology.spec}: {topology.cells} cells, degree {degree}, diameter {topology.diameter}"


def _draw(topology: "Topology", name: str) -> None:
    """Cells as dots, numbered if there is room; rectangles as they are, others on a circle."""
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    from supernode.picture import save

    places = [_spot(topology, cell) for cell in range(topology.cells)]
    links = {(min(a, b), max(a, b)) for a, slots in enumerate(topology.table().tolist()) for b in slots if a != b}
    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.add_subplot(aspect="equal")
    lines = LineCollection([_line(places[a], places[b], len(topology.place(a)) == 2) for a, b in sorted(links)])
    lines.set(color="0.6", linewidth=0.8)
    axes.add_collection(lines)
    size = 20.0 / math.sqrt(topology.cells)
    axes.plot(*zip(*places, strict=True), "o", color="tab:blue", markersize=max(1.0, size))
    if topology.cells <= 128:
        for cell, (x, y) in enumerate(places):
            axes.annotate(
                str(cell), (x, y), (0, max(3.0, size / 2)), textcoords="offset points", ha="center", fontsize=7
            )
    axes.set_axis_off()
    axes.set_title(_words(topology), fontsize=9)
    save(figure, name)


def _spot(topology: "Topology", cell: int) -> tuple[float, float]:
    place = topology.place(cell)
    if len(place) == 2:
        return float(place[1]), -float(place[0])
    angle = 2.0 * math.pi * cell / topology.cells
    return math.sin(angle), math.cos(angle)


def _line(start: tuple[float, float], end: tuple[float, float], flat: bool) -> list[tuple[float, float]]:
    """Straight; links round a torus are bent, or they would hide those between."""
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
