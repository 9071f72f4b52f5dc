"""Write the motion that a result holds, over time: as CSV, as JSON, or as MCAP for Foxglove and the like."""

import argparse
import contextlib
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from supernode import exits

if TYPE_CHECKING:
    from problems import BadInput, Problem, ProblemFile
    from problems.motion import Motion

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
    from problems import load
    from problems.guard import moved
    from problems.motion import Pace
    from problems.registry import find
    from supernode.claims import judged

    pace = Pace(options.speed, options.turn_speed, options.rate)
    kind_of_file, file = _format(options), load(options.problem)
    with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
        if not _moves(find(file.kind, file.folder)):
            raise _no_motion(file)
        judgement = judged(file, options.result)
        if judgement.solution is None or judgement.objections:
            print("rejected: " + "; ".join(judgement.objections), file=sys.stderr)
            return exits.NOT_REACHED
        motion = moved(judgement.problem, judgement.solution, pace)
        if motion is None:
            raise _no_motion(file)
    _write(_rendered(motion, file.kind, kind_of_file), options.output)
    return exits.OK


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
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


def _moves(kind: "type[Problem]") -> bool:
    from problems import Problem

    return kind.motion is not Problem.motion


def _no_motion(file: "ProblemFile") -> "BadInput":
    from problems import BadInput
    from problems.registry import find_built_in, kinds

    known = ", ".join(kind for kind in kinds() if _moves(find_built_in(kind)))
    return BadInput(f"{file.name}: kind: expected one whose solution is a motion ({known}), found {file.kind!r}")


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
