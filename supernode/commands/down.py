"""End a running cluster with all its processes; jobs that have not ended are kept in its state folder.

If the cluster's processes were started separately (`router`, `coordinator`, `spy`, `node`), only the coordinator ends.
"""

import argparse
import time

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, place_of, tell

EXAMPLE = "supernode down"

_END_WITHIN = 60.0  # seconds: a thousand processes are gone in three, but machines may be busy
_ANSWER_WITHIN = 1.0  # seconds until a router that does not answer counts as gone


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the cluster."""
    add_cluster_options(parser, "that it is down")


def run(options: argparse.Namespace) -> int:
    """Ask the cluster to end and wait until it has; on this machine, end it even if it does not answer."""
    from pathlib import Path

    from supernode.client.cluster_info import is_occupied

    place = place_of(options)
    info = place.info()
    ends = _ask(options)
    if info is None:
        _wait_until_away(options, ends)
    elif ends is not None or is_occupied(Path(place.folder or "")):
        _wait_for_exit(info.process, ends is not None, place)
    alone = ends == "coordinator" and info is None  # of an engine's cluster the lifeline ends all
    rest = "; router, spy and nodes end where they were started, or with `up --on`" if alone else ""
    tell(options, {"down": str(place), "ended": ends or "cluster"}, f"down: {place}{rest}")
    return exits.OK


def _ask(options: argparse.Namespace) -> str | None:
    """Return what ends, as the cluster answers; None if a cluster on this machine does not answer."""
    from coordinator.errors import ClusterFailed
    from supernode.commands.cluster_options import connected

    try:
        with connected(options) as client:
            return client.down()
    except ClusterFailed:
        if options.connect is not None:  # a cluster elsewhere cannot be ended by a signal
            raise
        return None


def _wait_until_away(options: argparse.Namespace, ends: str | None) -> None:
    """Wait until the cluster no longer answers at its endpoint."""
    from coordinator.errors import ClusterFailed

    until = time.monotonic() + _END_WITHIN
    while _is_there(options, ends):
        if time.monotonic() > until:
            raise ClusterFailed(f"the {ends} at {options.connect} has not ended within {_END_WITHIN:.0f} s")
        time.sleep(0.02)


def _is_there(options: argparse.Namespace, ends: str | None) -> bool:
    """Return whether what ends is still there: the coordinator, or the router, the last process of a whole cluster."""
    import zenoh

    from coordinator.errors import ClusterFailed
    from supernode.commands.cluster_options import connected, identity_of
    from wire import sessions

    try:
        if ends == "coordinator":
            connected(options).close()
        else:
            sessions.visitor(options.connect, _ANSWER_WITHIN, identity_of(options, "client")).close()  # type: ignore[no-untyped-call]
    except (ClusterFailed, zenoh.ZError):
        return False
    return True


def _wait_for_exit(process: int, answered: bool, place: object) -> None:
    """Wait until the cluster's lifeline process has ended; if the cluster did not answer, end that process.

    Raises:
        ClusterFailed: if it has not ended in time.
    """
    import os
    import signal

    from coordinator.errors import ClusterFailed

    until = time.monotonic() + _END_WITHIN
    try:
        if not answered:
            os.kill(process, signal.SIGTERM)
        while time.monotonic() < until:
            os.kill(process, 0)  # raises once the process is gone
            time.sleep(0.02)
    except ProcessLookupError:
        return
    raise ClusterFailed(f"the cluster in {place} has not ended within {_END_WITHIN:.0f} s (process {process})")
