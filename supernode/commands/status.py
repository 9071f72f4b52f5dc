"""A running cluster: what each of its nodes does, and how many jobs there are."""

import argparse
from collections.abc import Mapping
from typing import Any

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, connected, tell

EXAMPLE = "supernode status"

_COLUMNS = ("node", "process", "job", "cell", "world", "generation", "age", "memory", "sent", "received")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which cluster."""
    add_cluster_options(parser, "all that is known")


def run(options: argparse.Namespace) -> int:
    """Print a table of nodes."""
    with connected(options) as client:
        status = client.status()
    tell(options, status, _words(status))
    return exits.OK


def _words(status: Mapping[str, Any]) -> str:
    from supernode.table import table

    nodes = status["nodes"]
    counts = ", ".join(f"{count} {state}" for state, count in status["jobs"].items() if count) or "none"
    head = f"cluster {status['cluster']}, supernode {status['version']}: {len(nodes)} nodes; jobs: {counts}"
    return "\n".join([head, table(_COLUMNS, [_row(node) for node in nodes])])


def _row(node: Mapping[str, Any]) -> list[object]:
    return [_shown(column, node) for column in _COLUMNS]


def _shown(column: str, node: Mapping[str, Any]) -> object:
    match column:
        case "age":
            seconds = node.get("seconds")
            return None if seconds is None else round(seconds)
        case "memory":
            memory = node.get("memory")
            return None if memory is None else f"{memory / 1e6:.1f} MB"
        case "cell":
            cell = node.get("cell")
            return f"({', '.join(map(str, cell))})" if isinstance(cell, list) else cell
    return node.get(column)
