"""Measure how fast the best individual takes over and how diversity decays, by shape and size of the torus.

Real processes on a few cores cannot reach these sizes. The simulator can, with the same state and the same draws.

Usage: python -m benchmarks.takeover [--seeds 10] [--most-cells 65536] [--plot takeover.png]

*Takeover* is measured under selection alone. An individual is one real gene, drawn at random, which is its own fitness.
A couple's two offspring, by uniform crossover without mutation, each have the gene of one parent. So genes serve as
names: each can be followed back to the first generation, in which one of them is the best of all. Takeover is the first
generation in which every individual of every cell has that name; half-time is the first in which half of them have it.

*Diversity* is measured in two ways. *Lineages* is the share of the first generation's names that still exist, under the
same selection alone. *Entropy* is the mean over bits of the entropy of that bit over all individuals, while the tuned
recipe minimises a trap of 60 bits.
"""

import argparse
import contextlib
import statistics
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

import topologies
from coordinator.experiments.statistics import median
from genetics import Fitness, Genomes, RealVector, Recipe
from node.plan import Plan
from node.simulation import simulate
from problems import Problem, Run
from problems.file import parse
from problems.tables import RecipeName

SHAPES = ("32x32", "16x64", "8x128", "4x256", "1x1024")
SIZES = ("4x4", "8x8", "16x16", "32x32", "256x256", "1024x1024")
ISLANDS = ((1, 1), (20, 1), (20, 10))  # deme, interval
MARKS = (1, 2, 4, 8, 16, 32, 64, 128)  # generations at which diversity is printed
_MOST_INDIVIDUALS_OF_ISLANDS = 1 << 15
_MOST_GENERATIONS_OF_ISLANDS = 700
_MOST_CELLS_OF_SEVERAL_SEEDS = 1 << 12
_TRAP = 'kind = "function"\nname = "trap"\ndimension = 60\n'
_FOREVER = 1 << 20  # generations


class Names(Problem):
    """A problem of selection alone: individuals are names, and the least name is the best."""

    is_batch_invariant = True

    @cached_property
    def coding(self) -> RealVector:
        """Return the coding: one real gene."""
        return RealVector(1, 0.0, 1.0)

    def evaluate(self, genomes: Genomes) -> Fitness:
        """Return each name as its own fitness."""
        return self.coding.genes(genomes)[:, 0]

    def recipe(self, name: RecipeName, deme: int) -> Recipe:
        """Return a recipe without mutation."""
        return Recipe("uniform", 0.0, "elitist")


class Takeover(NamedTuple):
    """The outcome of one run: the generations until half of the individuals, and all, had the best name."""

    half: int
    whole: int
    shares: list[float]  # share of individuals with the best name, by generation


Look = Callable[[int, Genomes, Fitness], bool]
"""Receives a generation, all genomes and their fitness; returns whether the run may end."""


class _EnoughError(Exception):
    """Raised to end a simulation whose rest is not needed."""


def watch(plan: Plan, look: Look) -> None:
    """Simulate until ``look`` returns true, or the run ends."""

    def snapshot(generation: int, genomes: Genomes, fitness: Fitness) -> None:
        if look(generation, genomes, fitness):
            raise _EnoughError

    with contextlib.suppress(_EnoughError):
        simulate(plan, snapshot=snapshot)


def selection_alone(shape: str, seed: int, deme: int = 1, interval: int = 1) -> Plan:
    """Return a job in which nothing but selection happens."""
    run = Run(topology=f"torus {shape}", deme=deme, interval=interval, seed=seed, generations=_FOREVER)
    return Plan(Names(kind="names"), run)


def trap(shape: str, seed: int) -> Plan:
    """Return a job with all tuned operators, on a function with many local optima. No target ends it."""
    file = parse(_TRAP, "takeover", Path())
    return Plan.of(file.with_run(topology=f"torus {shape}", seed=seed, generations=_FOREVER, target=-1.0))


def takeover(plan: Plan) -> Takeover:
    """Follow the best name of the first generation until every individual has it."""
    shares: list[float] = []
    best = np.inf

    def look(generation: int, _: Genomes, fitness: Fitness) -> bool:
        nonlocal best
        if generation == 0:
            best = float(fitness.min())
        shares.append(float(np.mean(fitness == best)))
        return shares[-1] == 1.0

    watch(plan, look)
    half = next(generation for generation, share in enumerate(shares) if share >= 0.5)
    return Takeover(half, len(shares) - 1, shares)


def soonest(shape: str, interval: int) -> int:
    """Return the first generation in which the farthest cell can have a name, which crosses one link in an exchange."""
    diameter = topologies.parse(f"torus {shape}").diameter
    return 0 if diameter == 0 else (diameter - 1) * interval + 1


def distinct(genomes: Genomes) -> float:
    """Return the number of different genomes as a share of all: (.., genome_bytes) to a number."""
    flat = np.ascontiguousarray(genomes).reshape(-1, genomes.shape[-1])
    return len(np.unique(flat.view(np.dtype((np.void, flat.shape[1]))))) / len(flat)


def entropy(genomes: Genomes, bits: int) -> float:
    """Return the mean entropy of a bit over all individuals, in bits: 1 at first, 0 when all are equal."""
    flat = genomes.reshape(-1, genomes.shape[-1])
    ones = np.zeros(8 * flat.shape[1])
    for first in range(0, len(flat), 1 << 16):  # in parts, because unpacking turns each bit into a byte
        ones += np.unpackbits(flat[first : first + (1 << 16)], axis=1).sum(axis=0)
    share = ones[:bits] / len(flat)
    mixed = share[(share > 0.0) & (share < 1.0)]
    surprise = mixed * np.log2(1.0 / mixed) + (1.0 - mixed) * np.log2(1.0 / (1.0 - mixed))
    return float(surprise.sum() / bits)


def decay(plan: Plan, diversity: Callable[[Genomes], float], marks: Sequence[int] = MARKS) -> list[float]:
    """Return the diversity at the generations ``marks``."""
    found: list[float] = []

    def look(generation: int, genomes: Genomes, _: Fitness) -> bool:
        if generation in marks:
            found.append(diversity(genomes))
        return generation >= marks[-1]

    watch(plan, look)
    return found


def main() -> None:
    """Print the tables, each line when it is measured."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10, help="runs of each kind; beyond 4096 cells there is one")
    parser.add_argument("--most-cells", type=int, default=1 << 20, help="leave larger tori out")
    parser.add_argument("--plot", help="write a picture")
    options = parser.parse_args()
    shapes = [shape for shape in dict.fromkeys((*SHAPES, *SIZES)) if _cells(shape) <= options.most_cells]
    curves = _print_takeover(shapes, options.seeds)
    lineages = _print_decay("lineages", shapes, options.seeds, selection_alone, distinct)
    entropies = _print_decay("entropy, bits", shapes, options.seeds, trap, lambda genomes: entropy(genomes, 60))
    if options.plot:
        _draw(curves, lineages, entropies, options.plot)


def _cells(shape: str) -> int:
    return topologies.parse(f"torus {shape}").cells


def _is_affordable(shape: str, deme: int, interval: int) -> bool:
    is_small = _cells(shape) * deme <= _MOST_INDIVIDUALS_OF_ISLANDS
    return is_small and soonest(shape, interval) <= _MOST_GENERATIONS_OF_ISLANDS


def _seeds(shape: str, seeds: int) -> range:
    return range(1, 2 if _cells(shape) > _MOST_CELLS_OF_SEVERAL_SEEDS else 1 + seeds)


def _print_takeover(shapes: Sequence[str], seeds: int) -> dict[str, list[float]]:
    """Print the takeover table; return the shares over time with single individuals, by shape."""
    curves = {}
    print("| torus | diameter | deme | interval | runs | soonest possible | half-time | takeover | / soonest |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|")
    for shape in shapes:
        for deme, interval in ISLANDS:
            if deme > 1 and not _is_affordable(shape, deme, interval):
                continue
            runs = [takeover(selection_alone(shape, seed, deme, interval)) for seed in _seeds(shape, seeds)]
            print(_takeover_line(shape, deme, interval, runs), flush=True)
            if deme == 1:
                curves[shape] = runs[0].shares
    print()
    return curves


def _takeover_line(shape: str, deme: int, interval: int, runs: Sequence[Takeover]) -> str:
    bound = soonest(shape, interval)
    half = statistics.median(run.half for run in runs)
    times = median([float(run.whole) for run in runs])
    assert times is not None, "there are runs"
    between = "" if times.low is None or times.low == times.high else f" ({times.low:.0f} to {times.high:.0f})"
    diameter = topologies.parse(f"torus {shape}").diameter
    return (
        f"| {shape} | {diameter} | {deme} | {interval} | {len(runs)} | {bound} | {half:.0f} "
        f"| {times.value:.0f}{between} | {times.value / bound:.2f} |"
    )


def _print_decay(
    name: str,
    shapes: Sequence[str],
    seeds: int,
    plan: Callable[[str, int], Plan],
    diversity: Callable[[Genomes], float],
) -> dict[str, list[float]]:
    """Print a table of diversity; return the medians at `MARKS`, by shape."""
    curves = {}
    print(f"| {name} after | runs | {' | '.join(map(str, MARKS))} |")
    print("|---|---:|" + "---:|" * len(MARKS))
    for shape in shapes:
        runs = [decay(plan(shape, seed), diversity) for seed in _seeds(shape, seeds)]
        curves[shape] = [statistics.median(values) for values in zip(*runs, strict=True)]
        print(f"| {shape} | {len(runs)} | {' | '.join(f'{value:.3g}' for value in curves[shape])} |", flush=True)
    print()
    return curves


def _draw(
    curves: dict[str, list[float]], lineages: dict[str, list[float]], entropies: dict[str, list[float]], name: str
) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 7), layout="constrained")
    spread, names, by_shape, by_size = figure.subplots(2, 2).flat
    for shape in (each for each in SHAPES if each in curves):
        spread.plot(curves[shape], label=shape)
        names.loglog(MARKS, lineages[shape], label=shape)
        by_shape.semilogx(MARKS, entropies[shape], label=shape)
    for shape in (each for each in SIZES if each in curves):
        by_size.semilogx(MARKS, entropies[shape], label=shape)
    spread.set(title="the best takes over, selection alone", ylabel="share of cells that have it")
    names.set(title="lineages, selection alone", ylabel="share of the first names left")
    by_shape.set(title="diversity by shape, 1024 cells, trap", ylabel="entropy of a bit, bits")
    by_size.set(title="diversity by size, trap", ylabel="entropy of a bit, bits")
    for axes in (spread, names, by_shape, by_size):
        axes.set_xlabel("generation")
        axes.grid(alpha=0.3)
        axes.legend()
    figure.savefig(name, dpi=120)


if __name__ == "__main__":
    main()
