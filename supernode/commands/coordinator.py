"""Run the coordinator of a cluster whose processes are started separately: it takes jobs, and nodes join it."""

import argparse

from supernode import exits
from supernode.commands.checkpoint_options import add_checkpoint
from supernode.commands.cluster_options import add_eval_timeout, identity_of
from supernode.commands.role_options import (
    add_log_json,
    add_membership,
    add_option,
    add_trust,
    cluster_of,
    endpoint_of,
    modules_of,
    number_of,
    prepare_process,
    secret_of,
)
from supernode.commands.run_options import positive

EXAMPLE = "supernode coordinator --connect tcp/192.168.1.7:7447 --nodes 16"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the cluster, its least size, and where its jobs are kept."""
    add_membership(parser)
    add_option(parser, "nodes", "how many nodes will join at least; jobs that need more are refused", metavar="N")
    add_option(parser, "max-nodes", "let no more nodes join; further hosts wait for room (no limit)", metavar="N")
    add_option(parser, "state", "the folder that keeps the jobs (the user's default one)", metavar="DIR")
    add_option(parser, "database", "keep the jobs in this database, not in a file in the state folder", metavar="URL")
    add_option(parser, "max-queue", "refuse a client's jobs when this many of its wait (no limit)", metavar="N")
    add_option(parser, "client-nodes", "let the jobs of a client have at most N nodes together (no limit)", metavar="N")
    add_log_json(parser)
    add_option(parser, "keep-days", "delete ended jobs and records that are older (30)", metavar="D", default="30")
    add_option(parser, "keep-records", "keep only the newest N of each kind (1000000)", metavar="N", default="1000000")
    add_trust(parser)
    add_eval_timeout(parser)
    parser.add_argument(
        "--host-timeout", metavar="S", type=positive, help="let jobs fail whose host was away for so many seconds (120)"
    )
    add_checkpoint(parser, "30s")


def run(options: argparse.Namespace) -> int:
    """Coordinate until a signal arrives or a client ends the coordinator."""
    router, cluster, nodes = endpoint_of(options), cluster_of(options), number_of(options, "nodes")
    from problems.errors import BadInput

    max_queue = None if options.max_queue is None else number_of(options, "max_queue", 0)
    client_nodes = None if options.client_nodes is None else number_of(options, "client_nodes")
    most_nodes = None if options.max_nodes is None else number_of(options, "max_nodes")
    if most_nodes is not None and most_nodes < nodes:
        raise BadInput(f"--max-nodes: expected at least --nodes, {nodes}, found {most_nodes}")
    database = options.database or _file(options.state)
    keep_days, keep_records = number_of(options, "keep_days"), number_of(options, "keep_records")
    identity = identity_of(options, "coordinator")
    secret = secret_of(options, identity)
    # Before anything that imports numpy: it reads its number of threads only once.
    prepare_process()
    from pathlib import Path

    from coordinator.jobs.client_limits import ClientLimits
    from coordinator.jobs.running import EVAL_TIMEOUT
    from coordinator.launch.imports import import_all
    from coordinator.service.host_book import HOST_TIMEOUT
    from coordinator.service.joined import preside
    from coordinator.service.process import Options
    from coordinator.store.record_book import Keep
    from node.node_config import NodeConfig
    from wire.sessions import is_plain_abroad

    import_all()
    keep, limits = Keep(keep_days, keep_records), (most_nodes, options.eval_timeout or EVAL_TIMEOUT, options.checkpoint)
    host_timeout = options.host_timeout or HOST_TIMEOUT
    unprotected = (router,) if is_plain_abroad(router) else ()
    how = Options(nodes, database, keep, options.log_json, *limits, host_timeout=host_timeout, unprotected=unprotected)
    config = NodeConfig(cluster, 0, "", Path(), router, secret, modules_of(options), identity=identity)
    preside(config, how, ClientLimits(max_queue, client_nodes))
    return exits.OK


def _file(state: str | None) -> str:
    """Return the URL of the database in a state folder; lock the folder for as long as this process runs.

    Raises:
        BadInput: if the folder cannot be made or used.
        ClusterFailed: if another cluster holds it.
    """
    from coordinator.store.database import url_in
    from supernode.client.cluster_info import Place, occupy

    folder = Place.of_folder(state).folder
    assert folder is not None, "that is what it was made of"
    occupy(folder)  # the descriptor stays open, and with it the lock, until the process ends
    return url_in(folder)
