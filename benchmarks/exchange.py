"""Measure what an exchange costs: lockstep tori with a trivial fitness, beside the plain-datagram floor.

Usage: python -m benchmarks.exchange [--torus 4x4,8x8] [--steps 100000]

CPU time is that of all processes of the cluster (nodes, router, spy, zygote and coordinator) during the job, by the
kernel's clock of each process. The floor is measured before and after each size, in the same run on the same machine,
as the difference of a long and a short exchange, which excludes the start and the end of processes. Only the ratio of
exchange and floor can be compared with other machines.
"""

import argparse
import time
from pathlib import Path

import supernode
import topologies
from benchmarks.datagram_floor import measure
from coordinator.experiments.measure import memory_of_nodes
from problems.file import parse

_PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\n'
_NEVER = -1.0  # no fitness is that low, so the job runs to its last generation
_WARM_UP = 50  # generations; pages are copied when a process first writes to them
_LEAST = 1000  # generations; with 100, a job's start and end would be a seventh of the time
_IDLE_SECONDS = 5.0
_COLUMNS = (
    "torus",
    "ready, s",
    "PSS of a node, MB",
    "idle, % of a core",
    "gone, s",
    "generations/s",
    "CPU µs per node and generation",
    "floor: generations/s",
    "floor: CPU µs",
    "CPU ratio",
    "publications and receipts",
    "lost",
)


def main() -> None:
    """Print a table with one line for each size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="4x4,8x8", help="sizes")
    parser.add_argument("--steps", type=int, default=100_000, help="nodes times generations of each size")
    options = parser.parse_args()
    print("| " + " | ".join(_COLUMNS) + " |")
    print("|---" * len(_COLUMNS) + "|")
    for shape in options.torus.split(","):
        print("| " + " | ".join(row(f"torus {shape}", options.steps)) + " |", flush=True)


def row(spec: str, steps: int) -> list[str]:
    """Measure one size and return its line of the table."""
    topology = topologies.parse(spec)
    generations = max(_LEAST, steps // topology.cells)
    file = parse(_PROBLEM, "benchmark", Path()).with_run(target=_NEVER)
    floors = [_floor(topology, generations)]
    with supernode.LocalCluster(topology=spec) as cluster:
        ready = cluster.seconds_to_ready
        idle = _idle_share(cluster)
        memory = memory_of_nodes(cluster)
        cluster.submit(file, generations=_WARM_UP).result()
        result = cluster.submit(file, generations=generations).result()
        leaving = time.monotonic()
    gone = time.monotonic() - leaving
    floors.append(_floor(topology, generations))
    floor_rate, floor_cpu = (sum(each) / len(floors) for each in zip(*floors, strict=True))
    cpu = result.cpu_seconds / topology.cells / generations * 1e6
    return [
        spec,
        f"{ready:.1f}",
        f"{memory / 1e6:.1f}",
        f"{100 * idle:.1f}",
        f"{gone:.1f}",
        f"{generations / result.seconds:,.1f}",
        f"{cpu:.1f}",
        f"{floor_rate:,.1f}",
        f"{floor_cpu:.1f}",
        f"{cpu / floor_cpu:.2f}",
        # The last generation is not published; each of the others is published once.
        f"{result.messages['sent'] / topology.cells / generations:g} and "
        f"{result.messages['received'] / topology.cells / generations:g}",
        str(result.messages["lost"]),
    ]


def _floor(topology: topologies.Topology, generations: int) -> tuple[float, float]:
    """Return generations per second, and CPU µs per node and generation, of plain datagrams."""
    short = max(1, generations // 4)
    (few_rate, few_cpu), (rate, cpu) = measure(topology, short), measure(topology, generations)
    seconds = generations / rate - short / few_rate
    return (generations - short) / seconds, (generations * cpu - short * few_cpu) / (generations - short)


def _idle_share(cluster: supernode.LocalCluster) -> float:
    """Return the share of one core that all processes of the cluster use without a job."""
    used = cluster.cpu_seconds()
    time.sleep(_IDLE_SECONDS)
    return (cluster.cpu_seconds() - used) / _IDLE_SECONDS


if __name__ == "__main__":
    main()
