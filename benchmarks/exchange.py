"""What an exchange costs: a lockstep torus of nodes with a trivial fitness, beside the plain-datagram floor.

Usage: python -m benchmarks.exchange [--torus 4x4,8x8] [--generations 400]

CPU time is that of all processes of the cluster during the job. Both columns come from one run on one machine; only
their ratio means anything elsewhere.
"""

import argparse
from pathlib import Path

import supernode
import topologies
from benchmarks.datagram_floor import measure

_PROBLEM = 'kind = "function"\nname = "onemax"\ndimension = 64\n'


def main() -> None:
    """Print a table, one line for each size."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="4x4,8x8", help="sizes")
    parser.add_argument("--generations", type=int, default=400)
    options = parser.parse_args()
    print("| torus | ready, s | PSS of a node, MB | generations/s | CPU µs per node and generation ", end="")
    print("| datagram floor: generations/s | CPU µs | CPU ratio |")
    print("|---|---|---|---|---|---|---|---|")
    for shape in options.torus.split(","):
        print(row(f"torus {shape}", options.generations), flush=True)


def row(spec: str, generations: int) -> str:
    """One line of the table."""
    topology = topologies.parse(spec)
    floor_rate, floor_cpu = measure(topology, generations)
    file = _problem()
    with supernode.LocalCluster(topology=spec) as cluster:
        ready = cluster.seconds_to_ready
        cluster.submit(file, target=-1.0, generations=5).result()
        memory = sum(_pss(process) for name, process in cluster.processes.items() if name.startswith("node"))
        result = cluster.submit(file, target=-1.0, generations=generations).result()
    cpu = result.cpu_seconds / topology.cells / generations * 1e6
    assert result.messages["lost"] == 0, result.messages
    cluster_columns = f"{memory / topology.cells / 1e6:.1f} | {generations / result.seconds:.0f} | {cpu:.0f}"
    return f"| {spec} | {ready:.2f} | {cluster_columns} | {floor_rate:.0f} | {floor_cpu:.0f} | {cpu / floor_cpu:.1f} |"


def _problem() -> supernode.ProblemFile:
    from problems.file import parse

    return parse(_PROBLEM, "benchmark", Path())


def _pss(process: int) -> float:
    """Proportional set size, bytes."""
    for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
        if line.startswith("Pss:"):
            return float(line.split()[1]) * 1024
    raise ValueError(f"process {process} tells no PSS")


if __name__ == "__main__":
    main()
