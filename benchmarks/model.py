"""A model of how fast a torus of single individuals goes, held against what is measured here.

Usage: python -m benchmarks.model [--calibrate 16,64,256,1024] [--predict 32,128,512] [--seconds 3] [--repeats 3]

With n cells on K cores, p = max(1, n / K) of them on each, a generation takes

    T = max(p (c(p) + e), c(p) + e + w + x)

- c(p): CPU time of a node and generation without evaluations. Processes that share a core push each other's state out
  of its caches: where that begins, and how steeply it goes on, is the machine's. So it is measured at some sizes, and
  a power of p between each two. Below the smallest size it is taken to be what it is there.
- K(n): the cores that the nodes keep busy when there is work for all, measured likewise. The spy, the router and the
  kernel have the rest.
- e: CPU time of its evaluations.
- w: what one waits for the last neighbour's message: processes are woken. Others on the same core work meanwhile.
- x: the network between machines, one way, if neighbours live on different ones. In lockstep everybody goes at the pace
  of the slowest cycle of neighbours, so one such link is enough.

w is measured on the largest of 1x2, 2x2, 3x3 with no more cells than the machine has cores (nodes of 1x2 have one
neighbour each). All other sizes that are printed are predicted. Left out: variation between generations and between
machines (the slowest of many delays in each exchange, so for many cores this is a bound, not an estimate), and
bandwidth. Async nodes wait for nobody, so w = x = 0; they breed several generations in a turn if those are short, so
their c(p) and K(n) are measured by themselves.

Other work on the machine shows as fewer cores busy than K, and then only the CPU times can be held against the model.
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
from coordinator.scaling.experiment import torus_of
from problems import ProblemFile
from problems.file import parse

_SHORT = 5  # generations of the job that is taken off the longer ones: what it costs to prepare and to stop
_SLOTS = 4
_EVALUATIONS = 2 * _SLOTS  # of a node in a generation
_MOST_OF_OTHERS = 256  # nodes of jobs other than the trivial one in lockstep: with more each takes minutes


class Measured(NamedTuple):
    """A torus: its nodes, the seconds of a generation, and the nodes' CPU seconds, each."""

    nodes: int
    seconds: float
    cpu: float

    @property
    def cores(self) -> float:
        """How many the nodes keep busy."""
        return self.nodes * self.cpu / self.seconds


@dataclass(frozen=True)
class Model:
    """The measured numbers, in seconds; see above.

    Attributes:
        sizes: tori of more nodes than cores, the smallest first.
        wait: w.
    """

    sizes: tuple[Measured, ...]
    wait: float

    @staticmethod
    def of(sizes: Iterable[Measured], alone: Measured) -> "Model":
        """From some sizes, and a torus that has a core for each cell."""
        return Model(tuple(sorted(sizes)), max(0.0, alone.seconds - alone.cpu))

    def cores_of(self, nodes: int) -> float:
        """K(n)."""
        cores = [size.cores for size in self.sizes]
        return float(np.interp(log(nodes), [log(size.nodes) for size in self.sizes], cores))

    def cpu_of(self, nodes: int, cores: float | None = None) -> float:
        """c(p); on the cores of the calibration, unless others are given."""
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
        """T; on the cores of the calibration, unless others are given.

        Args:
            nodes: n.
            cores: K.
            extra: CPU time of a generation beside a trivial one: e.
            network: x.
            waits: False in async mode.
        """
        cores = self.cores_of(nodes) if cores is None else cores
        each = max(1.0, nodes / cores)
        work = self.cpu_of(nodes, cores) + extra
        return max(each * work, work + self.wait + network) if waits else each * work


def error(predicted: float, measured: float) -> float:
    """In percent of what is measured."""
    return 100.0 * (predicted / measured - 1.0)


class Variant(NamedTuple):
    """A kind of job: which fitness, and in which mode."""

    name: str
    fields: str
    mode: str

    @property
    def file(self) -> ProblemFile:
        """The problem; its target is out of reach."""
        text = f'kind = "function"\nname = "onemax"\ndimension = 64\n{self.fields}\n'
        return parse(text, self.name, Path()).with_run(target=-1.0, mode=self.mode)


LOCKSTEP, ASYNC = (Variant(mode, "", mode) for mode in ("lockstep", "async"))


def costly(cost: float) -> list[Variant]:
    """Both with a fitness that takes ``cost`` µs."""
    dear = f"cost_us = {cost:g}"
    return [Variant(f"{plain.name}, {cost:g} µs", dear, plain.mode) for plain in (LOCKSTEP, ASYNC)]


@contextmanager
def _cluster_of(nodes: int) -> Iterator[LocalCluster]:
    """A cluster that may take its time to end, without spoiling what was measured."""
    cluster = LocalCluster(topology=torus_of(nodes))
    try:
        yield cluster
    finally:
        try:
            cluster.close()
        except ClusterFailed as failure:
            print(f"{nodes} nodes: {failure}", file=sys.stderr, flush=True)


def measure(cluster: LocalCluster, variant: Variant, seconds: float, repeats: int) -> Measured:
    """Jobs of at least so many ``seconds``, each less a short one: medians of both times."""
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
    """Seconds, and CPU seconds of all nodes together."""
    before = _nodes_cpu(cluster)
    result = cluster.submit(variant.file, generations=generations).result()
    assert result.generations == generations, result
    return result.seconds, _nodes_cpu(cluster) - before


def _nodes_cpu(cluster: LocalCluster) -> float:
    return sum(used for name, used in cluster.cpu_seconds_by_process().items() if name.startswith("node"))


def main() -> None:
    """Calibrate, predict, compare, extrapolate."""
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
    """What evaluations cost is taken from the smallest torus, and predicted for the others."""
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
    """What a computer of many machines would do, one cell on each core: a table, and the traffic."""
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
    """The share of links that leave a square (or the most square block) of so many cells."""
    rows, columns = (int(each) for each in torus_of(cells).removeprefix("torus ").split("x"))
    return 2 * (rows + columns) / (_SLOTS * rows * columns)


if __name__ == "__main__":
    main()
