"""The options of the commands that can show a cluster in a browser."""

import argparse


def add_dashboard(parser: argparse.ArgumentParser) -> None:
    """Where the dashboard listens, and what visitors must know."""
    parser.add_argument(
        "--dashboard",
        metavar="ADDRESS",
        help="show the cluster in a browser there, such as 127.0.0.1:8080; port 0 is any free one (none)",
    )
    parser.add_argument(
        "--dashboard-token-file",
        metavar="FILE",
        help="what browsers must know; needed if others than this machine can reach ADDRESS",
    )
