"""Run as ``python stub_service.py ROUTER CLUSTER STORE NODES``: a coordinator whose jobs only pass the time."""

import os
import sys
from functools import partial
from pathlib import Path

from stub_dispatcher import StubDispatcher

from coordinator.jobs.client_limits import ClientLimits
from coordinator.service.process import Options, run
from coordinator.store.record_book import Keep
from node.node_config import NodeConfig
from problems.modules import Modules

if __name__ == "__main__":
    router, cluster, store, nodes = sys.argv[1:]
    config = NodeConfig(cluster, 0, f"ring {nodes}", Path("/nowhere"), router, bytes(32), Modules())
    most = os.environ.get("MAX_QUEUE")
    run(
        config,
        Options(int(nodes), store, Keep()),
        partial(StubDispatcher, limits=ClientLimits(None if most is None else int(most))),
    )
