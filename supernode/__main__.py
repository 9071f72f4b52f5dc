"""The command line: parses arguments, runs one command, and turns its errors into exit codes.

At the top only argparse and what the standard library has is imported; a command imports what it needs when it runs, so
that ``--help`` answers at once.
"""

import argparse
import importlib
import os
import re
import sys
from collections.abc import Sequence
from importlib.metadata import version
from typing import NoReturn

from supernode.exits import BAD_INPUT, FAILED, INTERRUPTED

_COMMANDS = {
    "solve": "solve a problem on a cluster of processes started for it, or on a running one",
    "simulate": "run the same job in this process: bit-identical to a lockstep solve",
    "resume": "let a run go on from its latest checkpoint, after its processes have ended",
    "check": "verify a result independently of the code that found it",
    "export": "write the motion of a result over time, or the records of a job: CSV, JSON, MCAP, Parquet",
    "view": "show the motion of a result in a browser, in three dimensions",
    "oracle": "compute the exact optimum of a problem, or a bound, where there is a method",
    "up": "start a cluster that stays up and takes jobs",
    "down": "end a running cluster",
    "status": "show what each node of a running cluster does",
    "submit": "submit a job to a running cluster, and print the job's id",
    "jobs": "list the jobs of a running cluster, or show one of them",
    "watch": "follow a job to its result, or watch the whole cluster",
    "logs": "print the log of a running cluster's processes",
    "update": "change the problem of a running job",
    "rewire": "give a running job another topology",
    "cancel": "end a job",
    "report": "write a page about a job, with figures and all that is needed to repeat it",
    "node": "join more nodes to a cluster, from here or from another machine",
    "keys": "make the keys by which a cluster knows its members, on every link",
    "deploy": "write the file with which Slurm or Kubernetes starts a cluster on many machines",
    "router": "run the router of a cluster whose processes are started separately",
    "coordinator": "run its coordinator",
    "spy": "run its spy, or show a running cluster in a browser",
    "chaos": "kill and stop processes of a cluster while it solves a problem; report what was lost",
    "scale": "measure how a problem scales with the number of nodes; write a table, plots and a report",
    "topology": "show cells, degree and diameter of a topology, and draw it",
    "problems": "list the kinds of problem, or the fields of one",
    "robots": "list robots that can be had offline, or show, check and draw one",
    "import": "write a problem file for a scene of MoveIt or a problem of MotionBenchMaker",
    "init": "write a commented problem file to start from",
}
_MODULES = {"import": "import_scene"}  # of commands whose names are words of Python


class _Parser(argparse.ArgumentParser):
    """An argument parser that reports an error in one line."""

    def error(self, message: str) -> NoReturn:
        message = message.removeprefix("argument ") + _suggested_choice(message)
        self.exit(BAD_INPUT, f"error: {message} (see `{self.prog} --help`)\n")


def _suggested_choice(message: str) -> str:
    """Return a suggestion if an unknown command or word is spelled much like a known one; else an empty text."""
    from problems.errors import did_you_mean

    found = re.search(r"invalid choice: '([^']*)' \(choose from (.*)\)", message)
    return did_you_mean(found[1], re.findall(r"[\w-]+", found[2])) if found else ""


def _refuse_unknown(options: argparse.Namespace, unknown: Sequence[str]) -> None:
    """Report unknown options, with a suggestion if the first is spelled much like a known one."""
    from problems.errors import did_you_mean

    word, known = unknown[0].partition("=")[0], options.parser._option_string_actions
    meant = did_you_mean(word, known) if word.startswith("--") else ""
    options.parser.error(f"unrecognized arguments: {' '.join(unknown)}{meant}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    parser = _parser()
    _check_environment(parser)
    # Unknown options are collected, so that the command's own parser can report them with a suggestion.
    options, unknown = parser.parse_known_args(arguments)
    if unknown:
        _refuse_unknown(options, unknown)
    return _run(options)


def _check_environment(parser: argparse.ArgumentParser) -> None:
    """Report a wrong SUPERNODE_PLAIN here: a child process would report it when the command has done half its work."""
    if "SUPERNODE_PLAIN" in os.environ:
        from lowlevel.capabilities import turned_off

        try:
            turned_off()
        except ValueError as error:
            parser.exit(BAD_INPUT, f"error: {error}\n")


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="supernode",
        description="Robot motion planning by a genetic algorithm on a torus of real processes.",
    )
    parser.add_argument("--version", action="version", version=f"supernode {version('supernode')}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, summary in _COMMANDS.items():
        module = importlib.import_module(f"supernode.commands.{_MODULES.get(name, name)}")
        command = commands.add_parser(
            name,
            help=summary,
            description=module.__doc__,
            epilog=f"example:\n  {module.EXAMPLE}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        module.add_arguments(command)
        command.set_defaults(run=module.run, parser=command)
    return parser


def _run(options: argparse.Namespace) -> int:
    try:
        _report_slow_steps(options)
        code: int = options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output has gone
        # Otherwise Python would try to flush stdout at exit, fail again and complain.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except Exception as error:
        return _report_error(error)
    return code


def _report_slow_steps(options: argparse.Namespace) -> None:
    """Report slow steps on stderr, for commands that read a problem file and are not quiet."""
    if {"problem", "source"} & vars(options).keys() and not getattr(options, "quiet", False):
        from problems import progress

        progress.set_listener(lambda line: print(line, file=sys.stderr, flush=True))


def _report_error(error: Exception) -> int:
    from coordinator.errors import ClusterFailed
    from problems.errors import BadInput, EvaluationFailed
    from wire.printable import printable_lines

    if isinstance(error, BadInput):
        code = BAD_INPUT
    elif isinstance(error, ClusterFailed | EvaluationFailed):
        code = FAILED
    else:
        raise error
    print(f"error: {printable_lines(str(error))}", file=sys.stderr)  # it may quote what a process elsewhere wrote
    return code


if __name__ == "__main__":
    sys.exit(main())
