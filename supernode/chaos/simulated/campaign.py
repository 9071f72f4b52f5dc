"""Many trials, on several processor cores, and what they have shown."""

import dataclasses
import os
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from typing import Any

from problems import ProblemFile
from supernode.chaos.simulated.drawing import drawn
from supernode.chaos.simulated.trial import Outcome, run, shortest


def trials(file: ProblemFile, first: int, number: int) -> Iterator[Outcome]:
    """Carry out the trials of the seeds from ``first`` on, and return their outcomes in that order.

    An outcome that shows something broken has the shortest plan that still breaks something.
    """
    seeds = range(first, first + number)
    processes = min(len(seeds), len(os.sched_getaffinity(0)))
    if processes <= 1:
        yield from (trial(file, seed) for seed in seeds)
        return
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        yield from pool.map(partial(trial, file), seeds)


def trial(file: ProblemFile, seed: int) -> Outcome:
    """Carry out the trial of a seed; if something is broken, return the outcome of the shortest plan that breaks it."""
    outcome = run(drawn(seed), file)
    return shortest(outcome, file) if outcome.broken else outcome


def as_json(outcome: Outcome) -> dict[str, Any]:
    """Return the outcome of a trial as plain values."""
    return dataclasses.asdict(outcome.plan) | {
        "simulated_seconds": outcome.seconds,
        "events": outcome.events,
        "lost": outcome.broken,
        "sha256": outcome.digest,
    }


def in_words(outcome: Outcome) -> str:
    """Return the outcome of a trial: what it did, and what was broken."""
    plan = outcome.plan
    lines = [
        f"draw {plan.seed}: {plan.topology}, {len(plan.hosts)} hosts, {len(plan.jobs)} jobs, {len(plan.faults)} faults,"
        f" {outcome.seconds:.1f} s simulated: {'broken' if outcome.broken else 'nothing lost'}"
    ]
    lines += [f"  broken: {each}" for each in outcome.broken]
    if outcome.broken:
        lines += [f"  {host.at:8.3f} s  host {host.name} comes with {host.nodes} nodes" for host in plan.hosts]
        lines += [f"  {job.at:8.3f} s  submit {job.settings()}" for job in plan.jobs]
        lines += [f"  {each.at:8.3f} s  {each.do} job {each.job}" for each in plan.requests]
        lines += [f"  the shortest way there, {len(plan.faults)} faults:"]
        lines += [f"  {fault.at:8.3f} s  {fault}" for fault in plan.faults]
    return "\n".join(lines)
