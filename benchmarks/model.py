"""Compare a model of the speed of a torus of single individuals with measurements on this machine.

Usage: python -m benchmarks.model [--calibrate 16,64,256,1024] [--predict 32,128,512] [--seconds 3] [--repeats 3]

With n cells on K cores, p = max(1, n / K) of them on each, a generation takes

    T = max(p (c(p) + e), c(p) + e + w + x)

- c(p): CPU time of a node and generation without evaluations. Processes that share a core evict each other's state
  from its caches. Where this begins, and how steeply it continues, depends on the machine. So c is measured at some
  sizes, and interpolated by a power of p between each two. Below the smallest size it is taken to be constant.
- K(n): the number of cores that the nodes keep busy when there is work for all, measured at the same sizes. The spy,
  the router and the kernel use the rest.
- e: CPU time of a node's evaluations in a generation.
- w: the wait for the last neighbour's message, because processes must be woken. Other nodes on the core work meanwhile.
- x: the network delay between machines, one way, if neighbours run on different machines. In lockstep all nodes have
  the pace of the slowest cycle of neighbours, so one such link is enough.

w is measured on the largest of 1x2, 2x2, 3x3 with no more cells than the machine has cores (nodes of 1x2 have one
neighbour each). All other sizes that are printed are predicted. The model omits bandwidth, and variation between
generations and machines. The slowest of many delays counts in each exchange, so for many cores the prediction is a
bound, not an estimate. Async nodes do not wait, so w = x = 0. They breed several generations in a turn if those are
short, so their c(p) and K(n) are measured separately.

Other load on the machine shows as fewer cores busy than K. Then only the CPU times can be compared with the model.
"""

import argparse
import os
import statistics
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import exp, log
from pathlib import Path
from typing import NamedTuple

import numpy as np

import topologies
from coordinator import ClusterFailed, LocalCluster
from coordinator.experiments.experiment import torus_of
from problems import ProblemFile
from problems.file import parse

_SHORT = 5  # generations of the job whose times are subtracted: the cost of preparing and stopping
_SLOTS = 4
_EVALUATIONS = 2 * _SLOTS  # of a node in a generation
_MOST_OF_OTHERS = 256  # nodes, except for the trivial lockstep job: with more each job takes minutes


class Measured(NamedTuple):
    """The measurements of a torus: nodes, seconds of a generation, and CPU seconds of each node in a generation."""

    nodes: int
    seconds: float
    cpu: float

    @property
    def cores(self) -> float:
        """Return the number of cores that the nodes keep busy."""
        return self.nodes * self.cpu / self.seconds


@dataclass(frozen=True)
class Model:
    """The parameters of the model, in seconds; see the module's docstring.

    Attributes:
        sizes: measured tori of more nodes than cores, the smallest first.
        wait: w.
    """

    sizes: tuple[Measured, ...]
    wait: float

    @staticmethod
    def of(sizes: Iterable[Measured], alone: Measured) -> "Model":
        """Return the model of some measured sizes, and of a torus that has a core for each cell (``alone``)."""
        return Model(tuple(sorted(sizes)), max(0.0, alone.seconds - alone.cpu))

    def cores_of(self, nodes: int) -> float:
        """Return K(n), interpolated over the logarithm of n."""
        cores = [size.cores for size in self.sizes]
        return float(np.interp(log(nodes), [log(size.nodes) for size in self.sizes], cores))

    def cpu_of(self, nodes: int, cores: float | None = None) -> float:
        """Return c(p), by default for the cores of the calibration."""
        cores = self.cores_of(nodes) if cores is None else cores
        on_each = [log(size.nodes / size.cores) for size in self.sizes]
        return exp(float(np.interp(log(nodes / cores), on_each, [log(size.cpu) for size in self.sizes])))

    def seconds(
        self,
        nodes: int,
        cores: float | None = None,
        extra: float = 0.0,
        network: float = 0.0,
        waits: bool = True,
    ) -> float:
        """Return T, by default for the cores of the calibration.

        Args:
            nodes: n.
            cores: K.
            extra: e, the CPU time of a generation beyond that of a trivial one.
            network: x.
            waits: False in async mode.
        """
        cores = self.cores_of(nodes) if cores is None else cores
        each = max(1.0, nodes / cores)
        work = self.cpu_of(nodes, cores) + extra
        return max(each * work, work + self.wait + network) if waits else each * work


def error(predicted: float, measured: float) -> float:
    """Return the error of a prediction, in percent of the measured value."""
    return 100.0 * (predicted / measured - 1.0)


class Variant(NamedTuple):
    """A kind of job: a fitness and a mode."""

    name: str
    fields: str
    mode: str

    @property
    def file(self) -> ProblemFile:
        """Return the problem; its target is out of reach."""
        text = f'kind = "function"\nname = "onemax"\ndimension = 64\n{self.fields}\n'
        return parse(text, self.name, Path()).with_run(target=-1.0, mode=self.mode)


LOCKSTEP, ASYNC = (Variant(mode, "", mode) for mode in ("lockstep", "async"))


def costly(cost: float) -> list[Variant]:
    """Return the lockstep and the async variant with a fitness that takes ``cost`` µs."""
    dear = f"cost_us = {cost:g}"
    return [Variant(f"{plain.name}, {cost:g} µs", dear, plain.mode) for plain in (LOCKSTEP, ASYNC)]


@contextmanager
def _cluster_of(nodes: int) -> Iterator[LocalCluster]:
    """Run a cluster; a failure while it ends is printed and does not discard the measurements."""
    cluster = LocalCluster(topology=torus_of(nodes))
    try:
        yield cluster
    finally:
        try:
            cluster.close()
        except ClusterFailed as failure:
            print(f"{nodes} nodes: {failure}", file=sys.stderr, flush=True)


def measure(cluster: LocalCluster, variant: Variant, seconds: float, repeats: int) -> Measured:
    """Measure jobs of at least ``seconds``, each less a short job; return the medians of both times."""
    generations = 8 * _SHORT
    while _run(cluster, variant, generations)[0] < seconds / 2:  # also warms up
        generations *= 2
    found = []
    for _ in range(repeats):
        short, long = _run(cluster, variant, _SHORT), _run(cluster, variant, 2 * generations)
        found.append([(after - before) / (2 * generations - _SHORT) for before, after in zip(short, long, strict=True)])
    nodes = cluster.topology.cells
    taken, cpu = (statistics.median(each) for each in zip(*found, strict=True))
    print(f"{nodes} nodes, {variant.name}: {1 / taken:.1f} generations/s", file=sys.stderr, flush=True)
    return Measured(nodes, taken, cpu / nodes)


def _run(cluster: LocalCluster, variant: Variant, generations: int) -> tuple[float, float]:
    """Return the seconds of a job, and the CPU seconds of all nodes together."""
    before = _nodes_cpu(cluster)
    result = cluster.submit(variant.file, generations=generations).result()
    assert result.generations == generations, result
    return result.seconds, _nodes_cpu(cluster) - before


def _nodes_cpu(cluster: LocalCluster) -> float:
    return sum(used for name, used in cluster.cpu_seconds_by_process().items() if name.startswith("node"))


def main() -> None:
    """Calibrate, predict, compare with measurements, and extrapolate."""
    options = _options()
    alone = max(square for square in (2, 4, 9) if square <= max(2, _cores()))
    measured: dict[tuple[Variant, int], Measured] = {}
    for nodes in sorted({alone, *options.calibrate, *options.predict}):
        asked = [LOCKSTEP, ASYNC, *costly(options.cost_us)] if alone < nodes <= _MOST_OF_OTHERS else [LOCKSTEP]
        with _cluster_of(nodes) as cluster:
            for each in asked:
                measured[each, nodes] = measure(cluster, each, options.seconds, options.repeats)
    models = {
        plain.mode: Model.of(
            [measured[plain, nodes] for nodes in options.calibrate if (plain, nodes) in measured],
            measured[LOCKSTEP, alone],
        )
        for plain in (LOCKSTEP, ASYNC)
    }
    print("\n".join(_fit(mode, model) for mode, model in models.items()))
    wait = models[LOCKSTEP.mode].wait
    print(f"{_cores()} cores here; w = {wait * 1e6:.0f} µs (on {torus_of(alone)}).", end="\n\n")
    del measured[LOCKSTEP, alone]
    print("| | nodes | cores busy | CPU µs of a node | model | error | generations/s | model | error |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for line in _lines(models, measured, options.calibrate):
        print(line)
    print()
    print("\n".join(beyond(models[LOCKSTEP.mode], options.machines, options.machine_cores, options.network_us)))


def _options() -> argparse.Namespace:
    def sizes(text: str) -> list[int]:
        return sorted(int(each) for each in text.split(","))

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calibrate", type=sizes, default=[16, 64, 256, 1024], help="of more nodes than cores")
    parser.add_argument("--predict", type=sizes, default=[32, 128, 512], help="tori to predict and measure")
    parser.add_argument("--seconds", type=float, default=3.0, help="of a job")
    parser.add_argument("--repeats", type=int, default=3, help="medians of so many")
    parser.add_argument("--cost-us", type=float, default=50.0, help="of an evaluation that costs something")
    parser.add_argument("--machines", type=int, default=100, help="of the large computer")
    parser.add_argument("--machine-cores", type=int, default=100, help="of each of its machines")
    parser.add_argument("--network-us", type=float, default=30.0, help="one way, between them")
    options = parser.parse_args()
    if options.calibrate[0] > _MOST_OF_OTHERS:
        parser.error(f"--calibrate: the smallest size may be {_MOST_OF_OTHERS} at most, found {options.calibrate[0]}")
    return options


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _fit(mode: str, model: Model) -> str:
    sizes = ", ".join(
        f"{size.nodes / size.cores:.0f} processes on each {size.cpu * 1e6:.0f} µs" for size in model.sizes
    )
    return f"Measured, {mode}: with {sizes}."


def _line(name: str, found: Measured, cpu: float, seconds: float) -> str:
    rate, predicted = 1.0 / found.seconds, 1.0 / seconds
    return (
        f"| {name} | {found.nodes} | {found.cores:.2f} | {found.cpu * 1e6:.0f} | {cpu * 1e6:.0f} "
        f"| {error(cpu, found.cpu):+.0f} % | {rate:,.1f} | {predicted:,.1f} | {error(predicted, rate):+.0f} % |"
    )


def _lines(
    models: Mapping[str, Model], measured: Mapping[tuple[Variant, int], Measured], calibrate: Sequence[int]
) -> Iterator[str]:
    """Yield the lines of the table. The cost of evaluations comes from the smallest torus."""
    small = calibrate[0]
    for (variant, nodes), found in measured.items():
        model, used = models[variant.mode], ""
        is_plain = variant in (LOCKSTEP, ASYNC)
        if is_plain and nodes in calibrate:
            used = " (calibrates)"
        elif nodes == small:
            used = " (CPU calibrates)"
        extra = 0.0 if is_plain else measured[variant, small].cpu - model.cpu_of(small)
        seconds = model.seconds(nodes, extra=extra, waits=variant.mode == LOCKSTEP.mode)
        yield _line(f"{variant.name}{used}", found, model.cpu_of(nodes) + extra, seconds)


def beyond(model: Model, machines: int, cores: int, network_us: float) -> list[str]:
    """Return a table of the speed of many machines with one cell on each core, and the traffic between them."""
    cells = machines * cores
    torus = topologies.parse(torus_of(cells))
    lines = [
        f"One cell on each of {cells:,} cores ({torus.spec}), in lockstep:",
        "",
        "| | µs of a generation | generations/s | messages/s | news crosses the torus in |",
        "|---|---:|---:|---:|---:|",
    ]
    costs = (0.0, 100.0, 1000.0, 10_000.0)
    networks = dict.fromkeys((0.0, network_us, 10 * network_us))
    for network in networks:
        for cost in costs if network == network_us else costs[:1]:
            seconds = model.seconds(cells, cells, _EVALUATIONS * cost * 1e-6, network * 1e-6)
            lines.append(
                f"| network {network:g} µs, evaluation {cost:g} µs | {seconds * 1e6:,.0f} | {1 / seconds:,.0f} "
                f"| {_SLOTS * cells / seconds:,.0f} | {torus.diameter * seconds * 1e3:,.1f} ms |"
            )
    crossing = crossing_share(cores)
    lines += [
        "",
        f"Of these messages {100 * crossing:.0f} % go from machine to machine, if each has a square of cells.",
    ]
    return lines


def crossing_share(cells: int) -> float:
    """Return the share of links that leave a square (or the most square block) of ``cells`` cells."""
    rows, columns = (int(each) for each in torus_of(cells).removeprefix("torus ").split("x"))
    return 2 * (rows + columns) / (_SLOTS * rows * columns)


if __name__ == "__main__":
    main()
