"""Options of the commands that can show a cluster in a browser."""

import argparse


def add_dashboard(parser: argparse.ArgumentParser) -> None:
    """Add where the dashboard listens, the tokens that visitors need, and the certificate that they see."""
    parser.add_argument(
        "--dashboard",
        metavar="ADDRESS",
        help="show the cluster in a browser at this address, such as 127.0.0.1:8080; port 0 is any free one (none)",
    )
    parser.add_argument(
        "--dashboard-token-file",
        metavar="FILE",
        help="a line for each token that lets visitors in, with the word read if they may only look; required if other"
        " machines can reach ADDRESS, as are the next two",
    )
    parser.add_argument("--dashboard-cert", metavar="FILE", help="speak TLS with this certificate, in PEM")
    parser.add_argument("--dashboard-key", metavar="FILE", help="the private key of the certificate, in PEM")
    parser.add_argument(
        "--dashboard-insecure",
        action="store_true",
        help="let other machines reach ADDRESS without TLS, such as a proxy that adds it",
    )
