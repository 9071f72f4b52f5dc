"""Pictures of results, in the manner of the papers' figures."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from node.plan import Plan
from problems import BadInput, ProblemFile
from problems.problem import Populations
from spy.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_FORMATS = ("png", "svg", "pdf")


def check_picture_name(name: str) -> None:
    """Refuse a name whose end is no format of a picture.

    Raises:
        BadInput: says which there are.
    """
    if Path(name).suffix.lower().lstrip(".") not in _FORMATS:
        raise BadInput(f"--plot: expected a name that ends in .png, .svg or .pdf, found {name}")


def save_picture(result: Result, file: ProblemFile, name: str) -> None:
    """Draw ``result`` into the file ``name``.

    Raises:
        BadInput: if the kind of problem has no picture, or the file cannot be written.
    """
    from matplotlib.figure import Figure

    plan = Plan.of(file)
    figure = Figure(figsize=(8, 6), layout="constrained")
    plan.problem.draw(figure, result.solution, _populations(result, plan))
    save(figure, name)


def save(figure: "Figure", name: str) -> None:
    """Write a picture in the format that its name ends with.

    Raises:
        BadInput: if the file cannot be written.
    """
    try:
        figure.savefig(name, dpi=150)
    except OSError as error:
        raise BadInput(f"--plot: expected a file that can be written, found {name}: {error.strerror}") from error


def _populations(result: Result, plan: Plan) -> Populations:
    """All individuals of the first generation (drawn again from the seed) and of the last."""
    cells = np.arange(plan.topology.cells)
    size = plan.coding.genome_bytes
    first = plan.coding.random(plan.keys(cells, 0), plan.run.deme)
    last = np.frombuffer(b"".join(result.demes), np.uint8)
    return {0: first.reshape(-1, size), result.generations: last.reshape(-1, size)}
