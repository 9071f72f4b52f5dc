"""Measure the share of the cores that costly evaluations get, in lockstep and asynchronously.

Usage: python -m benchmarks.costly [--torus 4x4,8x8,16x16] [--demes 1,8] [--microseconds 500] [--seconds 60]

Each evaluation takes ``--microseconds`` of processor time of its thread (`function` with `cost_us`), whatever else
runs. The share is the time of all evaluations divided by the time of all cores from the start of the job to its last
stop.
"""

import argparse
import itertools
import os
from pathlib import Path

import supernode
from problems.file import parse


def main() -> None:
    """Print a table with one line for each size, deme and mode."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="4x4,8x8,16x16", help="sizes")
    parser.add_argument("--demes", default="1,8", help="individuals on a node: it evaluates twice as many, 8 if alone")
    parser.add_argument("--microseconds", type=float, default=500.0, help="of each evaluation")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each run: its start and end take a second")
    options = parser.parse_args()
    file = parse(_problem(options.microseconds), "benchmark", Path()).with_run(target=-1.0, seconds=options.seconds)
    cores = len(os.sched_getaffinity(0))
    print(f"| torus | deme | mode | evaluations' share of {cores} cores | cores busy | generations/s | staleness |")
    print("|---|---|---|---|---|---|---|")
    for shape in options.torus.split(","):
        with supernode.LocalCluster(topology=f"torus {shape}") as cluster:
            for deme, mode in itertools.product(options.demes.split(","), ("lockstep", "async")):
                settings = {"mode": mode, "deme": int(deme)}
                cluster.submit(file, **settings, generations=2).result()  # warm-up
                result = cluster.submit(file, **settings).result()
                share = result.evaluations * options.microseconds * 1e-6 / result.seconds / cores
                stale = "" if result.staleness is None else f"{result.staleness['mean']:.2f}"
                print(
                    f"| {shape} | {deme} | {mode} | {share:.3f} | {result.cpu_seconds / result.seconds:.2f} "
                    f"| {result.generations / result.seconds:.1f} | {stale} |",
                    flush=True,
                )


def _problem(microseconds: float) -> str:
    return f'kind = "function"\nname = "onemax"\ndimension = 64\ncost_us = {microseconds}\n'


if __name__ == "__main__":
    main()
