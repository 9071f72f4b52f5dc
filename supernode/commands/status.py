"""Show what each node of a running cluster does, and how many jobs there are."""

import argparse
import os
import re
import socket
from collections.abc import Mapping
from typing import Any

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, connected, tell

EXAMPLE = "supernode status"

_COLUMNS = ("node", "process", "job", "cell", "epoch", "generation", "age", "reported", "memory", "sent", "received")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the cluster, and what to expect."""
    add_cluster_options(parser, "all that is known")
    parser.add_argument(
        "--expect",
        choices=("spy", "host"),
        help="fail unless the cluster has a spy, or nodes of this host [SUPERNODE_HOST]",
    )


def run(options: argparse.Namespace) -> int:
    """Print a table of nodes."""
    with connected(options) as client:
        status = client.status()
    _check(status, options.expect)
    tell(options, status, _words(status))
    return exits.OK


def _check(status: Mapping[str, Any], expected: str | None) -> None:
    """Check that what is expected is there.

    Raises:
        ClusterFailed: if it is not.
    """
    from coordinator.errors import ClusterFailed
    from supernode.deploy.surroundings import surroundings

    if expected == "spy" and status["spy"] is None:
        raise ClusterFailed("the cluster has no spy")
    if expected == "host":
        name, machine = os.environ.get("SUPERNODE_HOST") or surroundings(os.environ).name, socket.gethostname()
        # Without a name, `node` names its host after the machine and a process id.
        mine = re.compile(re.escape(name) if name else rf"{re.escape(machine)}-\d+")
        if not any(mine.fullmatch(node.get("host") or "") for node in status["nodes"]):
            raise ClusterFailed(f"the cluster has no nodes of host {name or machine}")


def _words(status: Mapping[str, Any]) -> str:
    from supernode.terminal.table import table

    nodes = status["nodes"]
    counts = ", ".join(f"{count} {state}" for state, count in status["jobs"].items() if count) or "none"
    head = f"cluster {status['cluster']}, supernode {status['version']}: {len(nodes)} nodes; jobs: {counts}"
    columns = (*_COLUMNS, "host") if any("host" in node for node in nodes) else _COLUMNS
    rows = [[_shown(column, node) for column in columns] for node in nodes]
    return "\n".join([head, *map(_spread, status["placements"]), table(columns, rows)])


def _spread(placement: Mapping[str, Any]) -> str:
    """Return how the cells of a job are spread over hosts."""
    hosts = ", ".join(f"{host} {cells}" for host, cells in placement["hosts"].items())
    crossing, edges = placement["crossing"], placement["edges"]
    return f"job {placement['job']}: cells by host: {hosts}; {crossing} of {edges} edges cross ({crossing / edges:.0%})"


def _shown(column: str, node: Mapping[str, Any]) -> object:
    match column:
        case "age" | "reported":  # of the process, and of its latest counters, in seconds
            seconds = node.get("seconds" if column == "age" else column)
            return None if seconds is None else round(seconds)
        case "memory":
            memory = node.get("memory")
            return None if memory is None else f"{memory / 1e6:.1f} MB"
        case "cell":
            cell = node.get("cell")
            return f"({', '.join(map(str, cell))})" if isinstance(cell, list) else cell
    return node.get(column)
