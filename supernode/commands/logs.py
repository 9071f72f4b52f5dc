"""Print the log of a running cluster's processes, oldest first: deaths, rejected messages, failures.

With --improvements, print the improvements from run logs that `--log` wrote. Equal lockstep runs have the same ones,
byte for byte. They are printed once; if several logs are given and they differ, the exit code is 3.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from supernode import exits
from supernode.commands.cluster_options import add_place, connected
from supernode.commands.run_options import whole

if TYPE_CHECKING:
    from supernode.client.client import Client

EXAMPLE = """supernode logs --job 5f3a09c1 --follow
  supernode logs --improvements run-1.jsonl run-2.jsonl"""

_LOOK_AGAIN = 0.5  # seconds between two questions with --follow


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add whose records to print and for how long, and the options of the cluster."""
    parser.add_argument("--job", metavar="JOB", help="only records about this job")
    parser.add_argument("--node", metavar="N", type=whole, help="only records of this node")
    parser.add_argument("--follow", action="store_true", help="go on printing new records until Ctrl-C")
    parser.add_argument(
        "--improvements", metavar="FILE", nargs="+", help="print and compare the improvements in run logs instead"
    )
    add_place(parser)
    parser.add_argument("--json", action="store_true", help="print each line as a JSON object")


def run(options: argparse.Namespace) -> int:
    """Print a line for each record."""
    if options.improvements is not None:
        return _compare(options.improvements)
    with connected(options) as client:
        for record in _records(client, options):
            print(json.dumps(record) if options.json else _line(record), flush=True)
    return exits.OK


def _compare(names: Sequence[str]) -> int:
    """Print the improvements of the first log if all others have the same; else say where one differs."""
    first, *others = names
    records = _improvements(first)
    for other in others:
        for number, (here, there) in enumerate(zip_longest(records, _improvements(other)), 1):
            if here != there:
                told = "\n".join(f"  {name}: {line or 'no more'}" for name, line in ((first, here), (other, there)))
                print(f"{other} differs from {first} in improvement {number}:\n{told}", file=sys.stderr)
                return exits.NOT_REACHED
    for record in records:
        print(record)
    return exits.OK


def _improvements(name: str) -> list[str]:
    """Return the improvement lines of a run log; all other lines hold times, which differ between equal runs.

    Raises:
        BadInput: if the file is not a run log.
    """
    from problems import BadInput
    from spy.run_log import IMPROVEMENT

    found = []
    try:
        with Path(name).open(encoding="utf-8") as file:
            for number, line in enumerate(file, 1):
                if not isinstance(event := json.loads(line), dict) or "event" not in event:
                    raise BadInput(f"{name}: expected an object with an event in line {number}, found something else")
                if event["event"] == IMPROVEMENT:
                    found.append(line.rstrip("\n"))
    except OSError as error:
        raise BadInput(f"{name}: expected a run log that can be read, found {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: expected a run log, JSON Lines, found {error}") from error
    return found


def _records(client: "Client", options: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """Yield the records, page by page; with --follow, ask for newer ones for ever."""
    after, more = 0, True
    while more or options.follow:
        page = client.logs(options.job, options.node, after)
        for row in page["rows"]:
            yield dict(zip(page["columns"], row, strict=True))
            after = row[0]  # the record's id
        more = page["more"]
        if not more and options.follow:
            time.sleep(_LOOK_AGAIN)


def _line(record: dict[str, Any]) -> str:
    from datetime import datetime

    from wire.printable import printable

    at = datetime.fromtimestamp(record["at"]).isoformat(sep=" ", timespec="milliseconds")
    about = "  ".join(f"{name} {record[name]}" for name in ("job", "cell", "generation") if record[name] is not None)
    return printable(f"{at}  {record['level']:7}  {record['process']}: {record['text']}{'  ' + about if about else ''}")
