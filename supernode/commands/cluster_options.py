"""Options that the commands for a running cluster share: where it is, and how their answer is printed."""

import argparse
import json
import os
from typing import TYPE_CHECKING, Any

from supernode.commands.run_options import positive, size

if TYPE_CHECKING:
    from supernode.client.client import Client
    from supernode.client.cluster_info import Place
    from wire.members import Identity


def add_cluster_options(parser: argparse.ArgumentParser, what: str = "the answer") -> None:
    """Add the options that say where the cluster is and whether to answer in JSON; ``what`` names the answer."""
    add_place(parser)
    parser.add_argument("--json", action="store_true", help=f"print {what} as JSON")


def add_place(parser: "argparse._ActionsContainer") -> None:
    """Add the options that say where the cluster is."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--state", metavar="DIR", help="the state folder of a cluster on this machine")
    where.add_argument("--connect", metavar="ENDPOINT", help="the endpoint of a cluster, such as tls/192.168.1.7:7447")
    add_keys(parser)


def add_keys(parser: "argparse._ActionsContainer") -> None:
    """Add the option that says who the process shows itself to be on encrypted links."""
    parser.add_argument(
        "--keys",
        metavar="DIR",
        default=os.environ.get("SUPERNODE_KEYS") or None,
        help="the folder with this process's keys, which `supernode keys` makes, for tls/ and quic/ [SUPERNODE_KEYS]",
    )


def identity_of(options: argparse.Namespace, role: str) -> "Identity | None":
    """Return who the process shows itself to be; None if the options name no keys.

    Raises:
        BadInput: if there are no keys of that role.
    """
    from pathlib import Path

    from supernode.files.key_folder import identity_in

    return None if options.keys is None else identity_in(Path(options.keys), role)


def add_force(parser: "argparse._ActionsContainer") -> None:
    """Add the option that starts more nodes than the machine can hold."""
    parser.add_argument("--force", action="store_true", help="start the nodes even if this machine cannot hold so many")


def add_node_timeout(parser: "argparse._ActionsContainer") -> None:
    """Add the option that says when a process that is stopped counts as dead."""
    words = "replace a process that has been stopped (SIGSTOP, say) for so many seconds (15)"
    parser.add_argument("--node-timeout", metavar="S", type=positive, default=15.0, help=words)


def add_own_cluster(parser: "argparse._ActionsContainer") -> None:
    """Add the options of a cluster that is started for one run."""
    add_force(parser)
    parser.add_argument(
        "--on-node-death",
        choices=("replace", "fail"),
        default="replace",
        help="whether another process takes the place of one that dies, or the job fails (replace)",
    )
    add_node_timeout(parser)
    add_evaluation_limits(parser)


def add_evaluation_limits(parser: "argparse._ActionsContainer") -> None:
    """Add the options that limit the time and the memory of an evaluation."""
    add_eval_timeout(parser)
    words = "the memory that a node may take for a problem's own code, such as 500M or 2G (no limit)"
    parser.add_argument("--node-memory", metavar="SIZE", type=size, help=words)


def add_sandbox(parser: "argparse._ActionsContainer") -> None:
    """Add the option that takes the network from processes that run users' modules."""
    words = "users' modules run without a network, on nodes with --node-memory 2G unless that is given"
    parser.add_argument("--sandbox", action="store_true", help=words)


def add_eval_timeout(parser: "argparse._ActionsContainer") -> None:
    """Add the option that says when an evaluation counts as endless: while its job runs, and once that is stopped."""
    words = (
        "end an evaluation in a problem's own code after so many seconds for each individual (no limit; 60 once its job"
        " is stopped)"
    )
    parser.add_argument("--eval-timeout", metavar="S", type=positive, help=words)


def add_job(parser: argparse.ArgumentParser, **more: Any) -> None:
    """Add the argument that names a job."""
    parser.add_argument("job", metavar="JOB", help="the job's id, as `submit` printed it", **more)


def connected(options: argparse.Namespace) -> "Client":
    """Return a client of the cluster that the options name.

    Raises:
        BadInput: if ENDPOINT is not an endpoint.
        ClusterFailed: if no cluster answers.
    """
    from supernode.client.client import Client

    return Client(place_of(options))


def place_of(options: argparse.Namespace) -> "Place":
    """Return the place of the cluster that the options name.

    Raises:
        BadInput: if ENDPOINT is not an endpoint.
    """
    from supernode.client.cluster_info import Place

    if options.connect is None:
        return Place.of_folder(options.state)
    return Place.at(options.connect, identity=identity_of(options, "client"))


def tell(options: argparse.Namespace, value: dict[str, Any], words: str) -> None:
    """Print an answer: ``value`` as JSON if the options ask for that, else ``words``."""
    from wire.printable import printable_lines

    print(json.dumps(value) if options.json else printable_lines(words))
