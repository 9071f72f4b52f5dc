"""Watch a running cluster, or follow one of its jobs to its result, which is printed as `solve` prints it."""

import argparse
import contextlib
import sys
import threading
from collections.abc import Iterator
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, add_job, connected, place_of
from supernode.commands.run_options import add_least_improvement

if TYPE_CHECKING:
    from rich.console import RenderableType

    from supernode.terminal.screen import Screen

EXAMPLE = "supernode watch 5f3a09c1"

_PERIOD = 0.5  # seconds between two looks at the log


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the job, and the options of the cluster."""
    add_job(parser, nargs="?")
    parser.add_argument("--plot", metavar="FILE", help="draw the result (PNG, SVG or PDF, by the name's end)")
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    add_least_improvement(parser)
    add_cluster_options(parser, "the result")


def run(options: argparse.Namespace) -> int:
    """Show everything until the end; Ctrl-C ends the watching, not the job."""
    return _watch_all(options) if options.job is None else _follow(options)


def _follow(options: argparse.Namespace) -> int:
    from problems import ProblemFile
    from supernode.pictures.picture import check_picture_name
    from supernode.terminal.following import Follower
    from supernode.terminal.present import present

    if options.plot is not None:
        check_picture_name(options.plot)
    with connected(options) as client, _below(options) as below:
        job = client.job(options.job)
        file = ProblemFile.from_json(job.show()["file"])
        follower = Follower(client, job, file, options.quiet, below=below, least=options.least_improvement)
        follower.show()
        result = follower.result()
    return present(result, file, options, interrupted=False)


@contextlib.contextmanager
def _below(options: argparse.Namespace) -> Iterator["RenderableType"]:
    """Yield what to show under the improvements: the job's cells, live, if stderr is a terminal."""
    if options.quiet or not sys.stderr.isatty():
        yield ""
        return
    from supernode.terminal.screen import Screen

    with Screen(place_of(options), options.job) as screen:
        yield screen


def _watch_all(options: argparse.Namespace) -> int:
    """Show the cluster until Ctrl-C: live on a terminal, else as a line for each log record."""
    from supernode.terminal.screen import Screen

    with connected(options), Screen(place_of(options)) as screen, contextlib.suppress(KeyboardInterrupt):
        if sys.stdout.isatty():
            _live(screen)
        else:
            _lines(screen)
    return exits.OK


def _live(screen: "Screen") -> None:
    from rich.live import Live

    with Live(screen, transient=True):
        threading.Event().wait()  # until Ctrl-C


def _lines(screen: "Screen") -> None:
    from wire.printable import printable

    told = 0
    while True:
        for line in screen.snapshot["lines"]:
            if line["number"] > told:
                told = line["number"]
                print(printable(f"{line['level']}: {line['text']}"), flush=True)
        threading.Event().wait(_PERIOD)
