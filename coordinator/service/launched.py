"""The coordinator of a cluster that one zygote launched, all on this machine."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import zenoh

import topologies
from coordinator.jobs.client_limits import ClientLimits
from coordinator.jobs.hooks import Hooks
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.service.process import Options, run
from coordinator.service.roster import Roster
from coordinator.service.service_dispatcher import ServiceDispatcher
from coordinator.store.database import url_in
from coordinator.store.record_book import Keep
from node.node_config import NodeConfig
from wire.keys import Keys
from wire.seal import Seal
from wire.sessions import is_plain_abroad


def coordinate(config: NodeConfig, options: Mapping[str, Any], first: bool) -> None:
    """Run the coordinator until a client or SIGTERM ends it.

    Args:
        config: the cluster's configuration.
        options: the fields of `coordinator.launch.launcher.ServiceOptions`.
        first: whether this is the first coordinator of the cluster. A later one does not know how the nodes are linked.
    """
    url = options["database"] or url_in(Path(options["state"]))
    cells = topologies.parse(config.topology).cells
    seal = Seal(config.secret)
    make_dispatcher = partial(
        LaunchedDispatcher,
        seal=seal,
        topology=config.topology,
        wired=first,
        limits=ClientLimits(options["max_queue"], options["client_nodes"]),
        eval_timeout=options["eval_timeout"] or EVAL_TIMEOUT,
    )
    keep = Keep(options["keep_days"], options["keep_records"])
    unprotected = tuple(each for each in options["listen"] if is_plain_abroad(each))
    every = options["checkpoint_every"]
    how = Options(cells, url, keep, options["log_json"], checkpoint_every=every, unprotected=unprotected)
    run(config, how, make_dispatcher)


class LaunchedDispatcher(ServiceDispatcher):
    """A dispatcher whose nodes are all there from the beginning."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        nodes: int,
        hooks: Hooks,
        *,
        seal: Seal,
        topology: str,
        wired: bool,
        limits: ClientLimits,
        eval_timeout: float,
    ) -> None:
        assert nodes == topologies.parse(topology).cells
        super().__init__(
            session, keys, seal, hooks, topology=topology, wired=wired, limits=limits, eval_timeout=eval_timeout
        )
        # A node that this coordinator sees for the first time may have been cut off while the one before was replaced.
        self._roster = Roster(
            session, keys, self.replaced, arrived=self.returned, returned=self.returned, heard=self.heard
        )
        if not wired:
            self._log("warning", "the coordinator has died: another one goes on in its place")
