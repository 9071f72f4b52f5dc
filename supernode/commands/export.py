"""Write the motion that a result holds, over time: as CSV, as JSON, or as MCAP for Foxglove and the like."""

import argparse
import contextlib
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from supernode import exits

if TYPE_CHECKING:
    from problems import Problem
    from problems.motion import Motion
    from supernode.claims import Judgement

EXAMPLE = "supernode export examples/mobile-robot.toml result.json --speed 0.5 -o motion.mcap"

_FORMATS = ("csv", "json", "mcap")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The problem and the result, the format, and how quick."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument("result", metavar="RESULT.json", help="a result as `solve --json` prints it, or its solution")
    parser.add_argument("--format", choices=_FORMATS, help="if not given, as FILE ends, else csv")
    parser.add_argument("-o", "--output", metavar="FILE", help="stdout if not given; mcap needs a file")
    parser.add_argument(
        "--speed",
        type=_positive,
        metavar="V",
        help="along a path that has no times, in its unit per second: m/s, rad/s (arm-path) or cells/s (terrain)",
    )
    parser.add_argument(
        "--turn-speed",
        type=_positive,
        metavar="W",
        help="rad/s, of a mobile-robot that turns; if not given, no point of it is quicker than --speed",
    )
    parser.add_argument(
        "--rate", type=_positive, metavar="HZ", help="rows a second (50); min-time has the rows of its solution"
    )


def run(options: argparse.Namespace) -> int:
    """Write the motion, if the check accepts the result."""
    from supernode.claims import judged

    kind_of_file = _format(options)
    judgement = judged(options.problem, options.result)
    with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
        motion = _motion(judgement, options)
    if motion is None:
        return exits.NOT_REACHED
    _write(_rendered(motion, judgement.problem.kind, kind_of_file), options.output)
    return exits.OK


def _positive(text: str) -> float:
    value = float(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number greater than 0, found {text}")
    return value


def _format(options: argparse.Namespace) -> str:
    from problems import BadInput

    ending = Path(options.output or "").suffix.lower().lstrip(".")
    chosen = str(options.format or (ending if ending in _FORMATS else "csv"))
    if chosen == "mcap" and options.output is None:
        raise BadInput("-o: expected a file to write MCAP to, found nothing")
    return chosen


def _motion(judgement: "Judgement", options: argparse.Namespace) -> "Motion | None":
    """None if there is nothing that could be driven, which it says."""
    from problems import BadInput
    from problems.guard import moved
    from problems.motion import Pace

    problem = judgement.problem
    if not _moves(type(problem)):
        raise BadInput(f"{options.problem}: kind: {_no_motion(problem.kind)}")
    if judgement.solution is None or judgement.objections:
        print("rejected: " + "; ".join(judgement.objections), file=sys.stderr)
        return None
    motion = moved(problem, judgement.solution, Pace(options.speed, options.turn_speed, options.rate))
    if motion is None:
        raise BadInput(f"{options.problem}: kind: {_no_motion(problem.kind)}")
    return motion


def _moves(kind: "type[Problem]") -> bool:
    from problems import Problem

    return kind.motion is not Problem.motion


def _no_motion(kind: str) -> str:
    from problems.registry import find_built_in, kinds

    known = ", ".join(each for each in kinds() if _moves(find_built_in(each)))
    return f"expected one whose solution is a motion ({known}), found {kind!r}"


def _rendered(motion: "Motion", kind: str, kind_of_file: str) -> bytes:
    from supernode import motion_text

    if kind_of_file == "mcap":
        from supernode.motion_mcap import as_mcap

        return as_mcap(motion)
    return (motion_text.as_csv(motion) if kind_of_file == "csv" else motion_text.as_json(motion, kind)).encode()


def _write(data: bytes, name: str | None) -> None:
    from problems import BadInput

    if name is None:
        sys.stdout.write(data.decode())
        return
    try:
        Path(name).write_bytes(data)
    except OSError as error:
        raise BadInput(f"-o: expected a file that can be written, found {name}: {error.strerror}") from error
