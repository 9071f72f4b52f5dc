"""What the processes of a running cluster had to say: deaths, rejected messages, failures; the oldest first."""

import argparse
import json
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from supernode import exits
from supernode.commands.cluster_options import add_place, connected
from supernode.commands.run_options import whole

if TYPE_CHECKING:
    from supernode.client import Client

EXAMPLE = "supernode logs --job 5f3a09c1 --follow"

_LOOK_AGAIN = 0.5  # seconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Whose, and for how long."""
    parser.add_argument("--job", metavar="JOB", help="of one job only")
    parser.add_argument("--node", metavar="N", type=whole, help="of one node only")
    parser.add_argument("--follow", action="store_true", help="go on as more comes, until Ctrl-C")
    add_place(parser)
    parser.add_argument("--json", action="store_true", help="print each line as a JSON object")


def run(options: argparse.Namespace) -> int:
    """Print a line for each record."""
    with connected(options) as client:
        for record in _records(client, options):
            print(json.dumps(record) if options.json else _line(record), flush=True)
    return exits.OK


def _records(client: "Client", options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Page by page; more of them may come while one is read."""
    after, more = 0, True
    while more or options.follow:
        page = client.logs(options.job, options.node, after)
        for row in page["rows"]:
            yield dict(zip(page["columns"], row, strict=True))
            after = row[0]
        more = page["more"]
        if not more and options.follow:
            time.sleep(_LOOK_AGAIN)


def _line(record: dict[str, Any]) -> str:
    from datetime import datetime

    at = datetime.fromtimestamp(record["at"]).isoformat(sep=" ", timespec="milliseconds")
    about = "  ".join(f"{name} {record[name]}" for name in ("job", "cell", "generation") if record[name] is not None)
    return f"{at}  {record['level']:7}  {record['process']}: {record['text']}{'  ' + about if about else ''}"
