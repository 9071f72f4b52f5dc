"""Draw pictures of results in the style of the papers' figures, and write them to files."""

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


def check_picture_name(name: str, option: str = "--plot") -> None:
    """Check that the file name of a picture, given by an option, ends in a known format.

    Raises:
        BadInput: if it does not; names the formats.
    """
    if Path(name).suffix.lower().lstrip(".") not in _FORMATS:
        raise BadInput(f"{option}: expected a name that ends in .png, .svg or .pdf, found {name}")


def drawn(
    problem: Problem,
    solution: Solution | None,
    populations: "Populations | None" = None,
    *,
    is_attempt: bool = False,
) -> "Figure":
    """Return the problem's own drawing of a solution, and of individuals by generation.

    Args:
        problem: the problem as it was run.
        solution: the solution as `Problem.decode` made it; None draws the problem alone.
        populations: all individuals of some generations.
        is_attempt: whether the check rejects the solution; the title then says so.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    problem.draw(figure, solution, populations or {})
    if is_attempt and solution is not None:
        title = figure.get_suptitle()
        figure.suptitle(_ATTEMPT + (f": {title}" if title else ""), color="#b00020")
    return figure


def as_png(figure: "Figure", dots_per_inch: int) -> bytes:
    """Return the figure as the bytes of a PNG file."""
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=dots_per_inch)
    return png.getvalue()


def save_picture(result: "Result", file: ProblemFile, name: str) -> None:
    """Draw the answer of ``result`` into the file ``name``.

    Args:
        result: the result of a run.
        file: the run's problem in its last epoch.
        name: the name of the picture's file; its end names the format.

    Raises:
        BadInput: if the kind of problem has no picture, or the file cannot be written.
    """
    from node.plan import Plan

    plan = Plan.of(file, _began_in(result))
    populations = _populations(result, plan)
    save(drawn(plan.problem, result.found, populations, is_attempt=result.solution is None), name)


def save(figure: "Figure", name: str) -> None:
    """Write a figure in the format that the file's name ends with.

    Raises:
        BadInput: if the file cannot be written.
    """
    try:
        figure.savefig(name, dpi=150)
    except OSError as error:
        raise BadInput(f"--plot: expected a file that can be written, found {name}: {error.strerror}") from None


def _began_in(result: "Result") -> int:
    """Return the epoch in which the last attempt began; its first individuals depend on that number."""
    return next((each["epoch"] for each in reversed(result.directives) if each["do"] == "retry"), 0)


def _populations(result: "Result", plan: "Plan") -> "Populations":
    """Return all individuals of the last attempt's first generation and of the last generation.

    A result holds the last one only. The first one is drawn again from the seed.
    """
    import numpy as np

    cells = np.arange(plan.topology.cells)
    size = plan.coding.genome_bytes
    first = plan.coding.random(plan.keys(cells, 0), plan.run.deme)
    last = np.frombuffer(b"".join(result.demes), np.uint8)
    return {0: first.reshape(-1, size), result.generations: last.reshape(-1, size)}
