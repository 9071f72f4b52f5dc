"""Show the motion of a result in a browser, in three dimensions; or the problem alone.

The page has a slider over the steps and a button that plays them. The command runs until Ctrl-C or SIGTERM.
"""

import argparse
import contextlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from supernode import exits

if TYPE_CHECKING:
    from problems import BadInput, Problem, ProblemFile

EXAMPLE = "supernode view examples/panda-shelf.toml result.json"

_HIGHEST_PORT = 65_535


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem, the result, and where to listen."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument(
        "result",
        metavar="RESULT.json",
        nargs="?",
        help="a result as `solve --json` prints it, or its solution; without it, the problem alone is shown",
    )
    parser.add_argument(
        "--host", default="127.0.0.1", help="the address to listen at (127.0.0.1: only this machine can connect)"
    )
    parser.add_argument("--port", type=_port, default=8080, metavar="N", help="the port (8080); 0 is any free one")


def run(options: argparse.Namespace) -> int:
    """Show the motion, if the check accepts the result."""
    from problems import load
    from problems.guard import animated
    from problems.registry import find
    from supernode.pictures.viewer import check_viser, serve
    from supernode.runs.claims import verified

    check_viser()
    file = load(options.problem)
    with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
        # Asked of the class, before the check of the result, which may take long.
        if not _is_animated(find(file.kind, file.folder)):
            raise _no_animation(file)
        if options.result is None:
            problem, solution = file.problem(), None
        else:
            judgement = verified(file, options.result)
            problem, solution = judgement.problem, judgement.solution
            if solution is None or judgement.objections:
                print("rejected: " + "; ".join(judgement.objections), file=sys.stderr)
                return exits.NOT_REACHED
        animation = animated(problem, solution)
    if animation is None:
        raise _no_animation(file) if solution is not None else _needs_result(file)
    serve(animation, Path(file.name).name, options.host, options.port)
    return exits.OK


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > _HIGHEST_PORT:
        raise argparse.ArgumentTypeError(f"expected a number from 0 to {_HIGHEST_PORT}, found {text}")
    return int(text)


def _is_animated(kind: "type[Problem]") -> bool:
    from problems import Problem

    return kind.animation is not Problem.animation


def _no_animation(file: "ProblemFile") -> "BadInput":
    from problems import BadInput
    from problems.registry import find_built_in, kinds

    known = ", ".join(kind for kind in kinds() if _is_animated(find_built_in(kind)))
    return BadInput(
        f"{file.name}: kind: expected one whose solution can be shown in space ({known}), found {file.kind!r}; "
        "`supernode solve --plot FILE` draws any kind"
    )


def _needs_result(file: "ProblemFile") -> "BadInput":
    from problems import BadInput

    return BadInput(f"{file.name}: RESULT.json: expected a result, since kind {file.kind!r} shows nothing without one")
