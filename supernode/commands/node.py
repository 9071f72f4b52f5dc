"""Join nodes of this machine or container to a cluster; they stay until the command ends."""

import argparse

from supernode import exits
from supernode.commands.cluster_options import (
    add_evaluation_limits,
    add_force,
    add_node_timeout,
    add_sandbox,
    identity_of,
)
from supernode.commands.role_options import (
    add_insecure,
    add_membership,
    add_option,
    add_trust,
    check_listen,
    cluster_of,
    endpoint,
    endpoint_of,
    modules_of,
    number_of,
    prepare_process,
    secret_of,
)

EXAMPLE = "supernode node --connect tcp/192.168.1.7:7447 --nodes 4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the cluster, how many nodes to join, and where they can be reached."""
    add_membership(parser)
    add_option(parser, "nodes", "how many nodes to join (one for each processor that it may use)", metavar="N")
    add_option(
        parser,
        "host",
        "this host's name, by which it gets its nodes back (what Slurm, Kubernetes or MPI call it; else the machine's"
        " name and a process id)",
    )
    add_option(
        parser,
        "label",
        "where this host is, from the largest unit to the smallest, such as hall2/rack7: hosts whose labels begin alike"
        " get neighbouring cells (the switches that Slurm names)",
        metavar="LABEL",
    )
    add_option(
        parser,
        "listen",
        "let nodes of other hosts connect here, at four ports for each node from this one on, such as"
        " tls/192.168.1.8:7450; 0.0.0.0 means this machine's own address (by default hosts are linked by the router)",
        metavar="ENDPOINT",
    )
    add_insecure(parser)
    add_trust(parser)
    parser.add_argument(
        "--lifeline",
        action="store_true",
        help="read the cluster's secret from standard input, and end when that ends (for `up --on ssh://HOST`)",
    )
    add_force(parser)
    add_node_timeout(parser)
    add_evaluation_limits(parser)
    add_sandbox(parser)


def run(options: argparse.Namespace) -> int:
    """Join the cluster, and stay until a signal arrives."""
    import os
    import secrets
    import socket

    from supernode.deploy.addresses import own_endpoint
    from supernode.deploy.lifeline import end_with_stdin, read_secret
    from supernode.deploy.surroundings import surroundings

    router, cluster, around = endpoint_of(options), cluster_of(options), surroundings(os.environ)
    _check_sandbox(options, router)
    nodes = around.nodes if options.nodes is None else number_of(options, "nodes")
    identity = identity_of(options, "node")
    listen = own_endpoint(endpoint(options.listen, "listen"), router) if options.listen else ""
    check_listen([listen] if listen else [], identity is not None, options.insecure)
    secret = read_secret() if options.lifeline else secret_of(options, identity)
    # Before anything that imports numpy: it reads its number of threads only once.
    prepare_process()
    if options.lifeline:
        end_with_stdin()
    from coordinator.launch.host import HostZygote
    from coordinator.launch.sandbox import node_memory
    from node.evaluation_limits import EvaluationLimits
    from wire.hosts import Host

    name = options.host or around.name or f"{socket.gethostname()}-{os.getpid()}"
    start = secrets.token_hex(4)
    host = Host(
        start if identity is None else identity.host_id(start), name, nodes, listen, label=options.label or around.label
    )
    limits = EvaluationLimits(options.eval_timeout, node_memory(options.node_memory, options.sandbox))
    HostZygote(
        cluster,
        router,
        secret,
        modules_of(options),
        host,
        force=options.force,
        node_timeout=options.node_timeout,
        limits=limits,
        identity=identity,
        sandbox=options.sandbox,
    ).run()
    return exits.OK


def _check_sandbox(options: argparse.Namespace, router: str) -> None:
    """Refuse a sandbox whose nodes would need a network.

    Raises:
        BadInput: if the router or other hosts are to be reached by one.
    """
    from problems.errors import BadInput
    from wire.sessions import UNIX_SOCKET

    if options.sandbox and not router.startswith(UNIX_SOCKET):
        raise BadInput(
            "--sandbox: expected --connect with the Unix socket of a cluster on this machine"
            f" ({UNIX_SOCKET}PATH), since nodes in the sandbox have no network, found {router}"
        )
    if options.sandbox and options.listen:
        raise BadInput(
            f"--listen: expected none with --sandbox, since its nodes have no network, found {options.listen}"
        )
