"""End a running cluster, with all its processes; jobs that have not ended are kept in its state folder."""

import argparse
import time

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, place_of, tell

EXAMPLE = "supernode down"

_END_WITHIN = 60.0  # seconds: a thousand processes are gone in three, but machines may be busy


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Which cluster."""
    add_cluster_options(parser, "that it is down")


def run(options: argparse.Namespace) -> int:
    """Ask, and wait until it has gone; on this machine also if it does not answer."""
    from pathlib import Path

    from supernode.whereabouts import is_occupied

    place = place_of(options)
    card = place.card()
    answered = _ask(options)
    if card is not None and (answered or is_occupied(Path(place.folder or ""))):
        _see_it_end(card.process, answered, place)
    tell(options, {"down": str(place)}, f"down: {place}")
    return exits.OK


def _ask(options: argparse.Namespace) -> bool:
    """Whether the cluster says that it will."""
    from coordinator.errors import ClusterFailed
    from supernode.commands.cluster_options import connected

    try:
        with connected(options) as client:
            client.down()
    except ClusterFailed:
        if options.connect is not None:
            raise
        return False
    return True


def _see_it_end(process: int, answered: bool, place: object) -> None:
    """Wait until the process that is the cluster's lifeline has ended; end it if it is of no use."""
    import os
    import signal

    from coordinator.errors import ClusterFailed

    until = time.monotonic() + _END_WITHIN
    try:
        if not answered:
            os.kill(process, signal.SIGTERM)
        while time.monotonic() < until:
            os.kill(process, 0)
            time.sleep(0.02)
    except ProcessLookupError:
        return
    raise ClusterFailed(f"the cluster in {place} has not ended within {_END_WITHIN:.0f} s (process {process})")
