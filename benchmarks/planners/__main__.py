"""Measure how good each planner is against its exact answer, on instances that no recipe was tuned on.

Usage: python -m benchmarks.planners [--quick] [--only arm-ik,terrain]

Each planner has a module here with a function ``section(quick)``, which measures and returns its part of
docs/results.md. A full run replaces the old part of the page. A quick run (few instances) only prints.
"""

import argparse
import datetime
import importlib
import os
import platform
from pathlib import Path

from problems import registry

_HEAD = """\
# How good the planners are

Written by `make planners`, or by `python -m benchmarks.planners --only KIND` for one planner. Instances come from
seeded generators; nobody tuned to those numbers."""
_PAGE = Path(__file__).resolve().parent.parent.parent / "docs" / "results.md"


def main() -> None:
    """Measure all planners, or some of them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="few instances: to see that it works")
    parser.add_argument("--only", default="", help="kinds, separated by commas")
    options = parser.parse_args()
    for kind in options.only.split(",") if options.only else measured():
        module = importlib.import_module(f"benchmarks.planners.{kind.replace('-', '_')}")
        section: str = module.section(options.quick)
        print(section, flush=True)
        if not options.quick:
            page = _PAGE.read_text(encoding="utf-8") if _PAGE.exists() else ""
            _PAGE.write_text(with_section(page, kind, f"{section}\n\n{_signature()}"), encoding="utf-8")


def measured() -> list[str]:
    """Return the kinds that have a part of the page."""
    return [kind for kind in registry.kinds() if kind != "function"]


def with_section(page: str, kind: str, section: str) -> str:
    """Return the page with the new part of one kind, which replaces the old part if there is one."""
    _, *parts = page.split("\n## ")
    sections = {part.splitlines()[0]: f"## {part.rstrip()}" for part in parts} | {kind: section}
    return "\n\n".join([_HEAD, *(sections[each] for each in measured() if each in sections)]) + "\n"


def _signature() -> str:
    machine = f"{len(os.sched_getaffinity(0))} cores, {platform.system()} {platform.release()}, {platform.machine()}"
    return f"*Measured on {datetime.date.today()}: {machine}, Python {platform.python_version()}.*"


if __name__ == "__main__":
    main()
