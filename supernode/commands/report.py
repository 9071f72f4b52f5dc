"""Write a page about a job of a running cluster: its outcome, how the run went, and all that is needed to repeat it.

The job may have ended or not. The page is one HTML file that needs no network.
"""

import argparse
import contextlib
import sys

from supernode import exits
from supernode.commands.cluster_options import add_job, add_place, connected

EXAMPLE = "supernode report 5f3a09c1 -o report.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the job, the file to write, and where the cluster is."""
    add_job(parser)
    parser.add_argument("-o", "--output", metavar="FILE", required=True, help="the file to write, such as report.html")
    add_place(parser)


def run(options: argparse.Namespace) -> int:
    """Ask the cluster, draw the figures, and write the page."""
    _check_libraries()
    from supernode.files.outputs import write_output
    from supernode.reports.report import report

    with connected(options) as client, contextlib.redirect_stdout(sys.stderr):  # a user's module may print
        page = report(client, options.job)
    write_output(page.encode(), options.output)
    return exits.OK


def _check_libraries() -> None:
    from importlib.util import find_spec

    from problems import BadInput

    if find_spec("jinja2") is None:
        raise BadInput("report: expected jinja2 to be installed: pip install 'supernode[report]'")
