"""Compute the exact optimum of a problem, or a bound, where there is a method; no genetic algorithm is involved."""

import argparse
import contextlib
import json
import math
import sys
import threading
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

from supernode import exits
from wire.plain import plain

if TYPE_CHECKING:
    from problems import Answer

EXAMPLE = "supernode oracle examples/arm-ik.toml"

_PATIENCE = 1.0  # seconds after which the command says that it is working


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument("--json", action="store_true", help="print the answer as one JSON object")
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")


def run(options: argparse.Namespace) -> int:
    """Print the figure, the method, and how long it took."""
    from problems import BadInput, load
    from problems.guard import oracle_answer

    file = load(options.problem)
    with contextlib.redirect_stdout(sys.stderr), _patience(options.quiet):  # a user's module may print
        problem = file.problem()
        started = time.perf_counter()
        try:
            answer = oracle_answer(problem)
        except BadInput as error:
            raise BadInput(f"{options.problem}: {error}") from None
        seconds = time.perf_counter() - started
    print(_json(answer, seconds) if options.json else _words(answer, seconds))
    return exits.OK


@contextlib.contextmanager
def _patience(quiet: bool) -> Iterator[None]:
    """Say on stderr that the oracle is at work, if it takes longer than `_PATIENCE`; with ``quiet``, never."""
    timer = threading.Timer(_PATIENCE, print, ["working out the exact answer …"], {"file": sys.stderr, "flush": True})
    if quiet:
        yield
        return
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()  # so that the line cannot come after the answer


def _json(answer: "Answer", seconds: float) -> str:
    return json.dumps(
        {
            "meaning": answer.meaning,
            "fitness": plain(answer.fitness),
            "method": answer.method,
            "seconds": seconds,
            "figures": plain(answer.figures),
            "solution": answer.solution,
        }
    )


def _words(answer: "Answer", seconds: float) -> str:
    figure = f"{answer.meaning} {answer.fitness:.9g}" if math.isfinite(answer.fitness) else "no feasible solution"
    figures = [f"{name}: {value:.6g}" for name, value in answer.figures.items()]
    return "\n".join([figure, f"by {answer.method}, in {seconds:.3g} s", *figures])
