"""How good each planner is, on instances that nobody tuned to, against its exact answer.

Usage: python -m benchmarks.planners [--quick] [--only arm-ik,terrain]

Each planner has a module here with a function ``section(quick)``, which measures and returns its part of the page. A
full run writes docs/results.md; a quick one (few instances), or one of some planners only, prints what it measured.
"""

import argparse
import datetime
import importlib
import os
import platform
from pathlib import Path

from problems import registry

_PAGE = Path(__file__).resolve().parent.parent.parent / "docs" / "results.md"


def main() -> None:
    """Measure all planners, or some."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few instances: to see that it works")
    parser.add_argument("--only", default="", help="kinds, separated by commas")
    options = parser.parse_args()
    kinds = options.only.split(",") if options.only else [kind for kind in registry.kinds() if kind != "function"]
    sections = []
    for kind in kinds:
        module = importlib.import_module(f"benchmarks.planners.{kind.replace('-', '_')}")
        sections.append(module.section(options.quick))
        print(sections[-1], flush=True)
    if not (options.quick or options.only):
        _PAGE.write_text("\n\n".join([_head(), *sections]) + "\n", encoding="utf-8")


def _head() -> str:
    machine = f"{len(os.sched_getaffinity(0))} cores, {platform.system()} {platform.release()}, {platform.machine()}"
    return (
        "# How good the planners are\n\n"
        f"Written by `make planners` on {datetime.date.today()} ({machine}, Python {platform.python_version()}).\n"
        "Instances come from seeded generators, seeds 1 and up, which nobody tuned to."
    )


if __name__ == "__main__":
    main()
