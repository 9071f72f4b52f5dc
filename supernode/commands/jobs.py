"""List the jobs of a running cluster, newest last; or show all about one of them."""

import argparse
import json
import time
from collections.abc import Mapping
from typing import Any

from supernode import exits
from supernode.commands.cluster_options import add_cluster_options, connected, tell

EXAMPLE = "supernode jobs --json"

_SHOWN = 20  # jobs listed without --all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the job, and the options of the cluster."""
    parser.add_argument("job", metavar="JOB", nargs="?", help="show this job only, with its best answer so far")
    parser.add_argument("--all", action="store_true", help=f"list all jobs, not only the newest {_SHOWN}")
    add_cluster_options(parser, "an array of jobs, or one job,")


def run(options: argparse.Namespace) -> int:
    """Print the jobs, or the job."""
    with connected(options) as client:
        if options.job is not None:
            view = client.job(options.job).show()
            tell(options, view, _one(view))
        else:
            jobs = client.jobs(None if options.all or options.json else _SHOWN)
            print(json.dumps(jobs) if options.json else _many(jobs))
    return exits.OK


def _many(jobs: list[dict[str, Any]]) -> str:
    from supernode.terminal.table import table

    if not jobs:
        return "no jobs"
    titles = ("job", "kind", "status", "fitness", "cells", "priority", "submitted", "seconds", "message")
    return table(titles, [_row(job) for job in jobs])


def _row(job: Mapping[str, Any]) -> list[object]:
    return [
        job["job"],
        job["kind"],
        job["status"],
        job["fitness"],
        job.get("cells"),
        job.get("priority"),
        _clock(job["submitted"]),
        _took(job),
        job.get("message") or "",
    ]


def _took(job: Mapping[str, Any]) -> float | None:
    """Return the seconds from acceptance to the end; None if the job has not ended."""
    ended = job.get("ended")
    return None if ended is None else round(ended - job["submitted"], 3)


def _clock(seconds: float | None) -> str:
    return "-" if seconds is None else time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(seconds))


def _one(view: Mapping[str, Any]) -> str:
    lines = [f"{view['job']}: {view['status']}" + (f": {view['message']}" if view.get("message") else "")]
    lines.append(f"  {view['kind']} on {view.get('cells')} cells, priority {view.get('priority')}")
    for name in ("submitted", "started", "ended"):
        if view.get(name) is not None:
            lines.append(f"  {name} {_clock(view[name])}")
    best = view.get("best")
    if best is not None:
        lines.append(f"  best: fitness {best['fitness']:.6g}, generation {best['generation']} of epoch {best['epoch']}")
    return "\n".join(lines)
