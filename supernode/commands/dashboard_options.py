"""Options of the commands that can show a cluster in a browser."""

import argparse


def add_dashboard(parser: argparse.ArgumentParser) -> None:
    """Add where the dashboard listens, and the file of the token that visitors need."""
    parser.add_argument(
        "--dashboard",
        metavar="ADDRESS",
        help="show the cluster in a browser at this address, such as 127.0.0.1:8080; port 0 is any free one (none)",
    )
    parser.add_argument(
        "--dashboard-token-file",
        metavar="FILE",
        help="the token that browsers need; required if other machines can reach ADDRESS",
    )
