"""Compare the time until a cluster is ready: agents on four nodes of Ray beside `LocalCluster`, on this machine.

Usage: python -m benchmarks.ray_cluster [--torus 32x32] [--hosts 4] [--turns 1]

The two are started in turns. Each solves the same problem in lockstep; the two histories must be equal. It needs the
extra `ray`.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any

import ray
from ray.cluster_utils import Cluster

import supernode

_PROBLEM = Path(__file__).parents[1] / "examples" / "rastrigin.toml"


def _started(make: Any, torus: str) -> tuple[float, str]:
    """Start a cluster, run a job, end it; return the seconds until it was ready and the job's `history_sha256`."""
    begun = time.monotonic()
    with make() as cluster:
        ready = time.monotonic() - begun
        result = cluster.submit(_PROBLEM, topology=f"torus {torus}", seed=1, generations=20).result(200)
    return ready, result.history_sha256


def _main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--torus", default="32x32")
    parser.add_argument("--hosts", type=int, default=4, help="nodes of Ray (default 4)")
    parser.add_argument("--turns", type=int, default=1, help="how often both are started (default 1)")
    arguments = parser.parse_args()
    nodes = math.prod(int(number) for number in arguments.torus.split("x"))
    engine = Cluster(initialize_head=True, head_node_args={"num_cpus": 2})
    try:
        for _ in range(arguments.hosts - 1):
            engine.add_node(num_cpus=2)
        ray.init(address=engine.address, log_to_driver=False)
        for turn in range(arguments.turns):
            local, one = _started(lambda: supernode.LocalCluster(torus=arguments.torus), arguments.torus)
            on_ray, other = _started(lambda: supernode.RayCluster(nodes=nodes), arguments.torus)
            equal = "equal" if one == other else "DIFFERENT"
            print(
                f"turn {turn + 1}: {nodes} nodes ready after {local:.1f} s in LocalCluster, {on_ray:.1f} s over "
                f"{arguments.hosts} agents on Ray ({on_ray / local:.2f} times); histories {equal}",
                flush=True,
            )
    finally:
        ray.shutdown()
        engine.shutdown()


if __name__ == "__main__":
    _main()
