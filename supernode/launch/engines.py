"""Choose the engine that `supernode up --on` names, and start a cluster on it."""

from collections.abc import Callable

from coordinator.launch.launcher import ServiceOptions
from problems.errors import BadInput
from supernode.deploy.engine_cluster import EngineCluster


def start_on(
    engine: str, nodes: int, service: ServiceOptions, given_up: Callable[[], bool], *, force: bool = False
) -> EngineCluster:
    """Start a cluster on an engine, and return it once its nodes have joined.

    Args:
        engine: ``ray`` for the Ray cluster of this machine, ``ray://HEAD:PORT``, or ``ssh://HOST,HOST``.
        nodes: how many nodes there shall be.
        service: the options of the cluster.
        given_up: whether nobody wants the cluster any more; asked while it starts.
        force: start the nodes even if a machine cannot hold so many.

    Raises:
        BadInput: if there is no such engine, or an option does not suit it.
        ClusterFailed: if the cluster does not come up, or is given up.
    """
    modules = service.allow_modules
    agent_options = ["--node-timeout", f"{service.node_timeout:g}", *_eval_timeout(service)]
    if service.node_memory is not None:
        agent_options += ["--node-memory", str(service.node_memory)]
    if force:
        agent_options.append("--force")
    scheme, _, place = engine.partition("://")
    if scheme == "ray" and bool(place) == ("://" in engine):
        from supernode.deploy.ray_cluster import RayCluster

        if service.listen:
            raise BadInput(f"--listen: expected none with --on ray, which chooses the machine, found {service.listen}")
        options = [*_options(service), *(("--database", service.database) if service.database else ())]
        address = engine if place else None
        return RayCluster(
            nodes,
            address=address,
            options=options,
            modules=modules,
            agent_options=agent_options,
            given_up=given_up,
        )
    if scheme == "ssh" and place:
        from coordinator.store.database import url_in  # not above: it loads SQLAlchemy
        from supernode.deploy.ssh_cluster import SshCluster

        assert service.state is not None, "`up` has one"
        options = [*_options(service), "--database", service.database or url_in(service.state)]
        return SshCluster(
            place.split(","),
            nodes,
            listen=service.listen,
            options=options,
            modules=modules,
            agent_options=agent_options,
            given_up=given_up,
        )
    raise BadInput(f"--on: expected ray, ray://HEAD:10001 or ssh://HOST,HOST, found {engine!r}")


def _eval_timeout(service: ServiceOptions) -> list[str]:
    return [] if service.eval_timeout is None else ["--eval-timeout", f"{service.eval_timeout:g}"]


def _options(service: ServiceOptions) -> list[str]:
    """Return the options of `supernode coordinator` that any engine's cluster is given."""
    if service.keep_days != int(service.keep_days):
        raise BadInput(f"--keep-days: expected whole days with --on, found {service.keep_days:g}")
    keep = ["--keep-days", str(int(service.keep_days)), "--keep-records", str(service.keep_records)]
    queue = [] if service.max_queue is None else ["--max-queue", str(service.max_queue)]
    if service.client_nodes is not None:
        queue += ["--client-nodes", str(service.client_nodes)]
    every = "off" if service.checkpoint_every is None else f"{service.checkpoint_every:g}s"
    limits = [*_eval_timeout(service), "--checkpoint", every]
    return [*limits, *keep, *queue, *(["--log-json"] if service.log_json else [])]
