"""Start a cluster that stays up and takes jobs: router, coordinator, spy and nodes, supervised."""

import argparse
from typing import TYPE_CHECKING

from supernode import exits
from supernode.commands.checkpoint_options import add_checkpoint
from supernode.commands.cluster_options import (
    add_evaluation_limits,
    add_force,
    add_keys,
    add_node_timeout,
    add_sandbox,
    identity_of,
)
from supernode.commands.dashboard_options import add_dashboard
from supernode.commands.role_options import add_insecure, add_log_json, check_listen
from supernode.commands.run_options import torus, whole

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from supernode.launch.detached import Ready

EXAMPLE = "supernode up --torus 4x4 --detach"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add how large the cluster is, and where it lives."""
    shape = parser.add_mutually_exclusive_group()
    shape.add_argument("--torus", metavar="RxC", type=torus, dest="topology", help="rows and columns (4x4)")
    shape.add_argument("--nodes", metavar="N", type=whole, help="N nodes, on the most square torus")
    shape.add_argument("--topology", metavar="SPEC", help='such as "torus 4x4" or "ring 16"')
    parser.add_argument(
        "--on",
        metavar="ENGINE",
        help="where the processes run: ray, ray://HEAD:10001 or ssh://HOST,HOST (this machine)",
    )
    parser.add_argument(
        "--listen",
        metavar="ENDPOINT",
        action="append",
        default=[],
        help="let clients connect here too, such as tls/0.0.0.0:7447 (by default only by a private Unix socket; with"
        " --on ssh at a free port)",
    )
    add_keys(parser)
    add_insecure(parser)
    parser.add_argument("--state", metavar="DIR", help="the state folder (the user's default one)")
    parser.add_argument("--database", metavar="URL", help="keep the jobs in this database, not in the state folder")
    parser.add_argument(
        "--max-queue", metavar="N", type=whole, help="refuse a client's jobs when this many of its wait (no limit)"
    )
    parser.add_argument(
        "--client-nodes",
        metavar="N",
        type=whole,
        help="let the jobs of one client have at most N nodes together (no limit)",
    )
    add_log_json(parser)
    parser.add_argument(
        "--keep-days", metavar="D", type=float, default=30.0, help="delete ended jobs and records that are older (30)"
    )
    parser.add_argument(
        "--keep-records", metavar="N", type=whole, default=1_000_000, help="keep the newest N of each kind (1000000)"
    )
    parser.add_argument(
        "--allow-module",
        metavar="M",
        action="append",
        default=[],
        help="let jobs use problems from this module of yours (none)",
    )
    add_dashboard(parser)
    add_force(parser)
    add_node_timeout(parser)
    add_evaluation_limits(parser)
    add_sandbox(parser)
    add_checkpoint(parser, "30s")
    parser.add_argument("--detach", action="store_true", help="return when the cluster is ready, and leave it running")


def run(options: argparse.Namespace) -> int:
    """Run the cluster until its end; or, with ``--detach``, return when it is ready."""
    from supernode.launch.detached import detached, leave_terminal

    if options.detach:
        print(detached(lambda ready: _keep_up(options, ready, leave_terminal)))
    else:
        _keep_up(options, lambda line: print(line, flush=True), lambda _: None)
    return exits.OK


def _keep_up(options: argparse.Namespace, ready: "Ready", log_to: "Callable[[Path], None]") -> None:
    from supernode.client.cluster_info import Place
    from supernode.launch.supervisor import Supervisor, launch_request_of

    folder = Place.of_folder(options.state).folder
    assert folder is not None
    identity = identity_of(options, "router")
    check_listen(options.listen, identity is not None, options.insecure)
    if options.on is not None:
        _check_engine(options)
    folder = folder.absolute()
    request = launch_request_of(options, folder, None if identity is None else identity.folder)
    Supervisor(request).run(folder, ready, lambda: log_to(folder / "up.log"))


def _check_engine(options: argparse.Namespace) -> None:
    """Check that the user knows what the processes of an engine's cluster listen to.

    Raises:
        BadInput: if not.
    """
    from problems.errors import BadInput

    if options.keys is not None:
        raise BadInput("--keys: expected none with --on; docs/containers.md starts the processes one by one, with keys")
    if not options.insecure:
        raise BadInput(
            f"--on {options.on}: its processes are linked by plain TCP: whoever reaches them could use the cluster;"
            " expected --insecure, in a network of trusted people alone"
        )
