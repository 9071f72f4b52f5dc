"""Write the motion of a result over time: as CSV, as JSON, as MCAP for Foxglove and the like, or for ROS.

Given a job instead, write its records as CSV or Parquet: its statistics of each second, or what --records asks for. The
job is one of a running cluster; it may have ended.
"""

import argparse
import contextlib
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.cluster_options import add_place, connected
from supernode.commands.run_options import positive

if TYPE_CHECKING:
    from problems import BadInput, Problem, ProblemFile
    from problems.motion import Motion

EXAMPLE = """supernode export examples/mobile-robot.toml result.json --speed 0.5 -o motion.mcap
  supernode export panda.toml result.json --retime -o motion.mcap
  supernode export 5f3a09c1 --format parquet -o statistics.parquet
  supernode export 5f3a09c1 --records events"""

_USAGE = """supernode export PROBLEM.toml RESULT.json [--format csv|json|mcap|ros] [-o FILE] [--retime] [--speed V] ...
       supernode export JOB [--records KIND] [--format csv|parquet] [-o FILE] [--state DIR | --connect ENDPOINT]"""

_KINDS = ("statistics", "improvements", "history", "events", "log")
_KIND = "statistics"  # the default: the only kind with rows from all of a run, however it went
_OF_MOTIONS = ("csv", "json", "mcap", "ros")
_OF_RECORDS = ("csv", "parquet")
_FORMATS = tuple(dict.fromkeys(_OF_MOTIONS + _OF_RECORDS))
_FOR_MOTIONS = {
    "result": "RESULT.json",
    "speed": "--speed",
    "acceleration": "--acceleration",
    "turn_speed": "--turn-speed",
    "turn_acceleration": "--turn-acceleration",
    "rate": "--rate",
    "retime": "--retime",
    "blend": "--blend",
}
_FOR_RECORDS = {"state": "--state", "connect": "--connect"}
_IN_FILES_ONLY = {"mcap": "MCAP", "parquet": "Parquet"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem and the result, or the job; the format, and the speeds of the motion."""
    parser.usage = _USAGE
    parser.add_argument("source", metavar="PROBLEM.toml | JOB", help="the problem file, or a job's id")
    parser.add_argument(
        "result", metavar="RESULT.json", nargs="?", help="a result as `solve --json` prints it, or its solution"
    )
    parser.add_argument(
        "--format",
        choices=_FORMATS,
        help="by default as FILE ends; csv if it has no ending. ros is the JSON of trajectory_msgs/JointTrajectory",
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="by default stdout; mcap and parquet need a file")
    motion = parser.add_argument_group("the motion of a result")
    motion.add_argument(
        "--speed",
        type=positive,
        metavar="V",
        help="the greatest speed along a path without times, in its unit per second: m/s, rad/s (arm-path) or cells/s "
        "(terrain)",
    )
    motion.add_argument(
        "--acceleration",
        type=positive,
        metavar="A",
        help="how fast speed is gained and lost, in that unit per second²; by default full speed is reached in 0.5 s",
    )
    motion.add_argument(
        "--turn-speed",
        type=positive,
        metavar="W",
        help="the greatest speed of turns, rad/s; by default no point of what turns is faster than --speed",
    )
    motion.add_argument(
        "--turn-acceleration",
        type=positive,
        metavar="B",
        help="rad/s²; by default turns reach full speed as soon as moves do",
    )
    motion.add_argument(
        "--rate", type=positive, metavar="HZ", help="rows per second (50); min-time has the rows of its solution"
    )
    motion.add_argument(
        "--retime",
        action="store_true",
        default=None,  # not False: only an option that is given can be refused
        help="robot-path: find the quickest motion along the path that keeps all limits, with rounded corners",
    )
    motion.add_argument(
        "--blend",
        type=_not_negative,
        metavar="D",
        help="with --retime: how far from a corner the motion may pass, rad or m (0.1; 0: stop at each corner)",
    )
    records = parser.add_argument_group("the records of a job")
    records.add_argument(
        "--records",
        metavar="KIND",
        choices=_KINDS,
        help="statistics of each second, improvements (verified, as the spy received them), history (improvements as "
        f"the cells recorded them, the same for equal lockstep runs), events (states and epochs) or log ({_KIND})",
    )
    add_place(records)


def run(options: argparse.Namespace) -> int:
    """Write the motion of a result, or the records of a job."""
    if options.records is None and options.result is None and not _is_file(options.source):
        options.records = _KIND
    _check_combination(options)
    return _run_motion(options) if options.records is None else _run_records(options)


def _is_file(source: str) -> bool:
    """Return whether ``source`` means a problem file, even a missing one, rather than a job."""
    return source.endswith(".toml") or Path(source).is_file()


def _check_combination(options: argparse.Namespace) -> None:
    """Refuse options that belong to the other form of the command."""
    from problems import BadInput

    if options.blend is not None and not options.retime:
        raise BadInput(f"--blend: expected only with --retime, found {options.blend:g}")
    if options.records is None and options.result is None:
        raise BadInput("RESULT.json: expected a result, or a job in place of PROBLEM.toml, found neither")
    foreign, only = (_FOR_RECORDS, "only with") if options.records is None else (_FOR_MOTIONS, "none with")
    for name, option in foreign.items():
        if (found := getattr(options, name)) is not None:
            raise BadInput(f"{option}: expected {only} --records, found {found}")


def _run_records(options: argparse.Namespace) -> int:
    """Write all records of the job."""
    from supernode.reports.records import pages, write_csv, write_parquet

    kind_of_file = _format(options, _OF_RECORDS)
    with connected(options) as client:
        found = pages(client, options.records, options.source)
        if kind_of_file == "parquet":
            write_parquet(found, options.output)
        else:
            write_csv(found, options.output)
    return exits.OK


def _run_motion(options: argparse.Namespace) -> int:
    """Write the motion, if the check accepts the result."""
    from problems import load
    from problems.guard import moved, retimed
    from problems.motion import Pace
    from problems.registry import find
    from supernode.runs.claims import verified

    speeds = (options.speed, options.turn_speed, options.acceleration, options.turn_acceleration)
    pace = Pace(*speeds, options.rate, options.blend, bool(options.retime))
    kind_of_file, file = _format(options, _OF_MOTIONS), load(options.source)
    with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
        # Asked of the class, before the check of the result, which may take long.
        if not _moves(find(file.kind, file.folder)):
            raise _no_motion(file)
        judgement = verified(file, options.result)
        if judgement.solution is None or judgement.objections:
            print("rejected: " + "; ".join(judgement.objections), file=sys.stderr)
            return exits.NOT_REACHED
        solution = judgement.solution
        if options.retime:
            solution = retimed(judgement.problem, solution, pace)
        motion = moved(judgement.problem, solution, pace)
        if motion is None:
            raise _no_motion(file)
    _write(_rendered(motion, file.kind, kind_of_file), options.output)
    for said in (*(f"limit: {limit}" for limit in motion.limits), *(f"note: {note}" for note in motion.notes)):
        print(said, file=sys.stderr)
    return exits.OK


def _not_negative(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise argparse.ArgumentTypeError(f"expected a number, 0 or greater, found {text}")
    return value


def _format(options: argparse.Namespace, known: tuple[str, ...]) -> str:
    from problems import BadInput

    ending = Path(options.output or "").suffix.lower().lstrip(".")
    by_ending = [each for each in known if each != "ros"]  # its files are JSON
    if options.format is None and ending and ending not in by_ending:
        endings = ", ".join(f".{each}" for each in by_ending)
        raise BadInput(f"-o: expected a file that ends in one of {endings}, or --format, found {options.output}")
    chosen = str(options.format or ending or "csv")
    if chosen not in known:
        raise BadInput(f"--format: expected one of {', '.join(known)}, found {chosen}")
    if chosen in _IN_FILES_ONLY and options.output is None:
        raise BadInput(f"-o: expected a file to write {_IN_FILES_ONLY[chosen]} to, found nothing")
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
    from supernode.motion import ros, text

    match kind_of_file:
        case "mcap":
            from supernode.motion.mcap_file import as_mcap

            return as_mcap(motion)
        case "ros":
            return ros.as_joint_trajectory(motion).encode()
        case "json":
            return text.as_json(motion, kind).encode()
    return text.as_csv(motion).encode()


def _write(data: bytes, name: str | None) -> None:
    from supernode.files.outputs import write_output

    if name is None:
        sys.stdout.write(data.decode())
    else:
        write_output(data, name)
