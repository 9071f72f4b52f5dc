"""Fuzz all targets, each for a number of minutes, as many at a time as there are cores.

Usage: python -m fuzz.run [--minutes 60] [--target NAME] [--folder .fuzz]

An error that is not the target's own, an input that takes more than the limits (`fuzz.limits`), or an answer 500 of the
dashboard is a finding. It ends its target. The input is kept, and what it did is printed with how to repeat it.
Inputs that reached new code are kept, too, and the next run begins with them.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from fuzz.limits import GIVEN_UP_AFTER, MOST_BYTES, MOST_MEGABYTES
from fuzz.targets import TARGETS

_DASHBOARD = "dashboard"
_NAMES = (*TARGETS, _DASHBOARD)
_SHOWN = 12  # last lines of a log


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz; return 1 if anything was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz.run", description=__doc__.partition("\n")[0])
    parser.add_argument("--minutes", type=float, default=60.0, help="for each target (%(default)g)")
    parser.add_argument("--target", choices=_NAMES, help="this one only")
    parser.add_argument("--folder", type=Path, default=Path(".fuzz"), help="of inputs and findings (%(default)s)")
    options = parser.parse_args(arguments)
    names = _NAMES if options.target is None else (options.target,)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        clean = list(pool.map(lambda name: _fuzz(name, options.minutes, options.folder / name), names))
    return 0 if all(clean) else 1


def _fuzz(name: str, minutes: float, folder: Path) -> bool:
    """Fuzz one target, print what came of it, and return whether nothing was found."""
    corpus, findings, log = folder / "corpus", folder / "findings", folder / "log"
    for each in (corpus, findings):
        each.mkdir(parents=True, exist_ok=True)
    if name in TARGETS:
        for number, seed in enumerate(TARGETS[name].seeds()):
            (corpus / f"seed-{number}").write_bytes(seed)
    before = set(findings.iterdir())
    with log.open("wb") as file:
        done = subprocess.run(_command(name, minutes, folder), stdout=file, stderr=subprocess.STDOUT, check=False)
    lines = log.read_text(errors="replace").splitlines()
    if done.returncode == 0:
        print(f"{name}: nothing found; {_last_state(lines)}", flush=True)
        return True
    print(f"{name}: FOUND something; {log} has more", *(f"    {line}" for line in lines[-_SHOWN:]), sep="\n")
    for path in sorted(set(findings.iterdir()) - before):
        print(f"    repeat it by: python -m fuzz.one {name} {path}", flush=True)
    return False


def _command(name: str, minutes: float, folder: Path) -> list[str]:
    seconds = round(60 * minutes)
    if name == _DASHBOARD:
        return [sys.executable, "-m", "fuzz.dashboard", "--seconds", str(seconds)]
    return [
        *(sys.executable, "-m", "fuzz.one", name),
        f"-max_total_time={seconds}",
        f"-timeout={GIVEN_UP_AFTER}",
        f"-rss_limit_mb={MOST_MEGABYTES}",
        f"-max_len={MOST_BYTES}",
        f"-artifact_prefix={folder / 'findings'}/",
        str(folder / "corpus"),
    ]


def _last_state(lines: list[str]) -> str:
    """Return the line that says how many inputs were tried, or how long the dashboard was asked."""
    return next((line for line in reversed(lines) if line.startswith(("Done ", "asked "))), "")


if __name__ == "__main__":
    sys.exit(main())
