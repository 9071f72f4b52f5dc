"""Run a large asynchronous torus for minutes; print nodes alive, their memory and descriptors, and messages lost.

Usage: python -m benchmarks.endurance [--torus 32x32] [--minutes 10]

The fitness costs nothing, so messages arrive as fast as possible. The first line shows the idle cluster.
"""

import argparse
import time
from pathlib import Path

import supernode
from coordinator.experiments.measure import memory_of_nodes
from problems.file import parse
from wire.news import Statistics

_PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\n'


def main() -> None:
    """Print a line before the job, one in each minute, one after the job, and its outcome."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="32x32", help="its size")
    parser.add_argument("--minutes", type=int, default=10, help="of the job")
    options = parser.parse_args()
    file = parse(_PROBLEM, "benchmark", Path()).with_run(target=-1.0, mode="async", seconds=60.0 * options.minutes)
    with supernode.LocalCluster(topology=f"torus {options.torus}") as cluster:
        print("| minute | processes alive | PSS of a node, MB | descriptors | messages lost |")
        print("|---:|---:|---:|---:|---:|")
        _look(cluster, "before", 0)
        job, start, minute = cluster.submit(file), time.monotonic(), 1
        for event in job.events():
            if isinstance(event, Statistics) and minute < options.minutes and time.monotonic() >= start + 60.0 * minute:
                _look(cluster, str(minute), event.lost)
                minute += 1
        result = job.result()
        _look(cluster, "after", result.messages["lost"])
        print(f"\n{result.evaluations:,} evaluations in {result.seconds:.0f} s; messages: {result.messages}")


def _look(cluster: supernode.LocalCluster, when: str, lost: int) -> None:
    """Print one line about all processes except the coordinator."""
    folders = [Path(f"/proc/{process}/fd") for process in cluster.processes.values()]
    alive = [list(folder.iterdir()) for folder in folders if folder.exists()]
    memory, descriptors = memory_of_nodes(cluster) / 1e6, sum(map(len, alive))
    print(f"| {when} | {len(alive)} | {memory:.2f} | {descriptors} | {lost} |", flush=True)


if __name__ == "__main__":
    main()
