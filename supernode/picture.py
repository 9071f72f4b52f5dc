"""Pictures of results, in the manner of the papers' figures."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

from problems import BadInput, Problem, ProblemFile, Solution

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from node.plan import Plan
    from problems.problem import Populations
    from spy.result import Result

_FORMATS = ("png", "svg", "pdf")
_ATTEMPT = "infeasible: the best attempt, not a solution"


def check_picture_name(name: str) -> None:
    """Refuse a name whose end is no format of a picture.

    Raises:
        BadInput: says which there are.
    """
    if Path(name).suffix.lower().lstrip(".") not in _FORMATS:
        raise BadInput(f"--plot: expected a name that ends in .png, .svg or .pdf, found {name}")


def drawn(
    problem: Problem,
    solution: Solution | None,
    populations: "Populations | None" = None,
    *,
    is_attempt: bool = False,
) -> "Figure":
    """The problem's own drawing of a solution, and of individuals by generation.

    Args:
        problem: as it was run.
        solution: as `Problem.decode` made it.
        populations: all individuals of some generations.
        is_attempt: whether the check has not accepted it; the title then says so.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    problem.draw(figure, solution, populations or {})
    if is_attempt and solution is not None:
        title = figure.get_suptitle()
        figure.suptitle(_ATTEMPT + (f": {title}" if title else ""), color="#b00020")
    return figure


def as_png(figure: "Figure", dots_per_inch: int) -> bytes:
    """The bytes of a picture file."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=dots_per_inch)
    return png.getvalue()


def save_picture(result: "Result", file: ProblemFile, name: str) -> None:
    """Draw ``result`` into the file ``name``.

    Args:
        result: what is drawn.
        file: the problem as it was last.
        name: of the picture's file.

    Raises:
        BadInput: if the kind of problem has no picture, or the file cannot be written.
    """
    from node.plan import Plan

    plan = Plan.of(file, _began_in(result))
    populations = _populations(result, plan)
    save(drawn(plan.problem, result.found, populations, is_attempt=result.solution is None), name)


def save(figure: "Figure", name: str) -> None:
    """Write a picture in the format that its name ends with.

    Raises:
        BadInput: if the file cannot be written.
    """
    try:
        figure.savefig(name, dpi=150)
    except OSError as error:
        raise BadInput(f"--plot: expected a file that can be written, found {name}: {error.strerror}") from None


def _began_in(result: "Result") -> int:
    """The epoch that the latest attempt began in."""
    return next((each["epoch"] for each in reversed(result.directives) if each["do"] == "retry"), 0)


def _populations(result: "Result", plan: "Plan") -> "Populations":
    """All individuals of the latest attempt's first generation (drawn again from the seed), and of the last."""
    import numpy as np

    cells = np.arange(plan.topology.cells)
    size = plan.coding.genome_bytes
    first = plan.coding.random(plan.keys(cells, 0), plan.run.deme)
    last = np.frombuffer(b"".join(result.demes), np.uint8)
    return {0: first.reshape(-1, size), result.generations: last.reshape(-1, size)}
