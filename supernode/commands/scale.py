"""Measure how a problem scales: make the same runs on tori of several sizes; write a table, plots and a report.

An interrupted experiment continues where it stopped when the same command is given again.
"""

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from supernode import exits
from supernode.commands.cluster_options import add_force

if TYPE_CHECKING:
    from coordinator.experiments.experiment import Parameters
    from problems import ProblemFile

EXAMPLE = "supernode scale examples/mobile-robot.toml --nodes 16,64 --repeats 5 -o office-scaling"

_LIBRARIES = ("pyarrow", "jinja2")
_SERIES = ("fixed-population", "growing-population", "budget")
_FORMATS = ("png", "svg", "pdf")
_MODES = ("lockstep", "async")
_OF_THE_EXPERIMENT = (
    "nodes",
    "repeats",
    "seeds",
    "modes",
    "demes",
    "series",
    "population",
    "budget",
    "evaluations",
    "sequential",
    "launches",
)
_OF_A_RUN = (
    "interval",
    "emigrants",
    "recipe",
    "replacement",
    "mutation",
    "spy",
    "generations",
    "seconds",
    "target",
    "stall",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add what to compare, how to run it, and where to write."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument("-o", "--output", metavar="DIR", required=True, help="the folder of the experiment")
    _add_grid(parser.add_argument_group("what to compare (lists are separated by commas)"))
    _add_run(parser.add_argument_group("how to run (each wins over the file's [run] table)"))
    add_force(parser)
    out = parser.add_argument_group("what to report")
    out.add_argument(
        "--plot-format", metavar="F,F", type=_among(_FORMATS), default=("png", "svg"), help="png, svg, pdf (png,svg)"
    )
    out.add_argument("--json", action="store_true", help="print the summary as one JSON object")
    out.add_argument("--quiet", action="store_true", help="no progress on stderr")


def _add_grid(grid: argparse._ArgumentGroup) -> None:
    from supernode.commands.run_options import whole

    grid.add_argument("--nodes", metavar="N,N", type=_wholes, help="sizes: each the most square torus (16,64)")
    grid.add_argument("--repeats", metavar="R", type=whole, help="runs of each kind on nodes, seeds 1 to R (5)")
    grid.add_argument(
        "--seeds",
        metavar="N",
        type=whole,
        help="runs of each kind in one process, without messages: verdicts on the search rest on these (100)",
    )
    grid.add_argument("--modes", metavar="M,M", type=_among(_MODES), help="lockstep, async (both)")
    grid.add_argument(
        "--demes", metavar="N,N", type=_wholes, help="growing-population and budget: individuals on a node (the file's)"
    )
    grid.add_argument(
        "--series", metavar="S,S", type=_among(_SERIES), help="fixed-population, growing-population, budget (all)"
    )
    grid.add_argument(
        "--population",
        metavar="N",
        type=whole,
        help="fixed-population: individuals on all nodes (least common multiple of sizes × deme)",
    )
    grid.add_argument("--budget", metavar="N", type=whole, help="budget: evaluations on all nodes (128 × population)")
    grid.add_argument("--sequential", metavar="N,N", type=_wholes, help="demes of the sequential reference (16,64,256)")
    grid.add_argument("--launches", metavar="N", type=whole, help="launches of each size; several give an interval (1)")


def _add_run(run: argparse._ArgumentGroup) -> None:
    from supernode.commands.run_options import add_breeding_options, number, whole

    add_breeding_options(run)
    run.add_argument("--target", metavar="F", type=number, help="the fitness to reach, instead of the problem's own")
    run.add_argument("--evaluations", metavar="N", type=whole, help="limit of a run to the target (1024 × population)")
    run.add_argument("--generations", metavar="N", type=whole, help="limit of a run on nodes (none)")
    run.add_argument(
        "--stall", metavar="N", type=whole, help="limit of a run on nodes without a better champion (none)"
    )
    run.add_argument(
        "--seconds", metavar="S", type=number, help="limit of any run; makes results depend on the machine"
    )


def run(options: argparse.Namespace) -> int:
    """Make the missing runs, write everything that is derived from all runs, and print the summary."""
    _check_libraries()
    from coordinator.experiments.experiment import design
    from coordinator.launch import capacity
    from problems import load

    file = load(options.problem)
    with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
        parameters = design(file, **_given(options))
        capacity.check(max(parameters.nodes), force=options.force)  # now, not after hours of smaller sizes
        text = _experiment(file, parameters, options)
    print(text)
    return exits.OK


def _check_libraries() -> None:
    from importlib.util import find_spec

    from problems import BadInput

    missing = [name for name in _LIBRARIES if find_spec(name) is None]
    if missing:
        raise BadInput(f"scale: expected {', '.join(missing)} to be installed: pip install 'supernode[scale]'")


def _given(options: argparse.Namespace) -> dict[str, Any]:
    names = (*_OF_THE_EXPERIMENT, *_OF_A_RUN)
    return {name: getattr(options, name) for name in names if getattr(options, name) is not None}


def _experiment(file: "ProblemFile", parameters: "Parameters", options: argparse.Namespace) -> str:
    """Run the whole experiment, and return the text to print."""
    from coordinator.experiments.describe import describe
    from coordinator.experiments.journal import Journal
    from coordinator.experiments.outputs import as_json, as_words, write_all
    from coordinator.experiments.runner import Runner
    from coordinator.experiments.summary import summarise
    from wire.printable import printable_lines

    def say(text: str) -> None:
        if not options.quiet:
            print(printable_lines(text), file=sys.stderr, flush=True)

    with Journal(Path(options.output), describe(file, parameters)) as journal:
        try:
            Runner(file, parameters, journal, say, force=options.force).run()
        except KeyboardInterrupt:
            say(f"interrupted; the same command goes on from here, {len(journal.runs)} runs are in {journal.folder}")
            raise
        summary = summarise(parameters, journal)
        write_all(summary, journal, options.plot_format)
    return as_json(summary, journal.folder) if options.json else as_words(summary, journal.folder)


def _wholes(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"expected whole numbers separated by commas, found {text!r}") from None


def _among(choices: tuple[str, ...]) -> Any:
    def parse(text: str) -> tuple[str, ...]:
        parts = tuple(part.strip() for part in text.split(","))
        if not set(parts) <= set(choices):
            raise argparse.ArgumentTypeError(f"expected some of {', '.join(choices)}, found {text!r}")
        return parts

    return parse
