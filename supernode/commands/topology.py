"""Show how many cells a topology has, how many neighbours a cell has, and how far messages travel; draw it."""

import argparse
import json
from typing import TYPE_CHECKING

from supernode import exits

if TYPE_CHECKING:
    from topologies import Topology

EXAMPLE = 'supernode topology "small-world 64 4 0.1 seed 1" --plot small-world.svg'


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the topology, and the file of the drawing."""
    parser.add_argument("spec", metavar="SPEC", help='such as "torus 4x4", "ring 16" or "hypercube 4"')
    parser.add_argument("--plot", metavar="FILE", help="draw it: PNG, SVG or PDF, by the name's end")
    parser.add_argument("--json", action="store_true", help="print one JSON object, with the neighbours of each cell")


def run(options: argparse.Namespace) -> int:
    """Print the figures, and draw."""
    import topologies
    from problems import BadInput
    from supernode.pictures.picture import check_picture_name

    if options.plot is not None:
        check_picture_name(options.plot)
    try:
        topology = topologies.parse(options.spec)
    except ValueError as error:
        raise BadInput(f"SPEC: {error}") from None
    print(json.dumps(_facts(topology)) if options.json else _words(topology))
    if options.plot is not None:
        _draw(topology, options.plot)
    return exits.OK


def _degrees(topology: "Topology") -> tuple[int, int]:
    """Return the least and the greatest number of other cells that a cell is linked with."""
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
    """Draw the topology; number the cells if there is room."""
    from matplotlib.figure import Figure

    from supernode.pictures.picture import save
    from supernode.pictures.topology_picture import draw_topology, spot, write_beside

    figure = Figure(figsize=(6, 6), layout="constrained")
    axes = figure.add_subplot()
    size = draw_topology(axes, topology)
    if topology.cells <= 128:
        for cell in range(topology.cells):
            write_beside(axes, str(cell), spot(topology, cell), size)
    axes.set_title(_words(topology), fontsize=9)
    save(figure, name)
