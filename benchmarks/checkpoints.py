"""What checkpoints cost: the same lockstep job on the same nodes with and without them, in turns.

    python -m benchmarks.checkpoints --nodes 16,64 --every 2 --seconds 20 --pairs 3

Prints generations per second with and without, their ratio for each pair, and what a checkpoint every 30 s would cost.
"""

import argparse
import statistics
import tempfile
from pathlib import Path

import supernode
import topologies

_PROBLEM = Path(__file__).resolve().parents[1] / "examples" / "rastrigin.toml"
_USUAL = 30.0  # seconds from one checkpoint to the next


def speed(cluster: supernode.LocalCluster, topology: str, seconds: float, every: float | None) -> float:
    """Return the generations per second of a job that ends after so many seconds."""
    file = supernode.load(_PROBLEM).with_run(topology=topology, deme=1, seconds=seconds, target=-1.0, stall=1 << 30)
    with tempfile.TemporaryDirectory() as folder:
        where = {} if every is None else {"checkpoints": Path(folder) / "run", "checkpoint_every": every}
        result = cluster.submit(file, topology=topology, **where).result()
    return result.generations / result.seconds


def main() -> None:
    """Measure each number of nodes, and print a line for each pair."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--nodes", default="16,64")
    parser.add_argument("--every", type=float, default=2.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--pairs", type=int, default=3)
    options = parser.parse_args()
    for nodes in map(int, options.nodes.split(",")):
        topology = topologies.torus_of(nodes)
        ratios = []
        with supernode.LocalCluster(topology=topology, kinds=["function"]) as cluster:
            for pair in range(options.pairs):
                order = (None, options.every) if pair % 2 == 0 else (options.every, None)  # neither is always first
                found = {every: speed(cluster, topology, options.seconds, every) for every in order}
                ratios.append(found[options.every] / found[None])
                print(
                    f"{nodes} nodes: {found[None]:.0f} generations/s, with {found[options.every]:.0f}: {ratios[-1]:.3f}"
                )
        cost = 1.0 - statistics.median(ratios)
        usual = cost * options.every / _USUAL
        print(f"{nodes} nodes: {cost:.1%} every {options.every:g} s; {usual:.2%} every {_USUAL:g} s")


if __name__ == "__main__":
    main()
