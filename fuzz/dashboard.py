"""Ask the dashboard of a running cluster for whatever schemathesis makes of its routes (`dashboard.yaml`).

Usage: python -m fuzz.dashboard [--seconds 60]

An answer 500, one that takes longer than the limit, a dashboard that died or one that is too large is a finding.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import supernode
from fuzz.limits import GIVEN_UP_AFTER, MOST_MEGABYTES
from fuzz.target import ROOT

_ROUTES = Path(__file__).with_name("dashboard.yaml")
_ENDLESS = {"topology": "torus 2x2", "target": -1.0, "generations": (1 << 31) - 1}


def main(arguments: Sequence[str] | None = None) -> int:
    """Start a cluster with a dashboard and a job, ask, and return 0 if nothing was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz.dashboard", description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=int, default=60, help="how long to ask (%(default)s)")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="fuzz-") as state:
        command = [*(sys.executable, "-m", "supernode", "up", "--topology", "torus 2x2"), "--state", state]
        up = subprocess.Popen([*command, "--dashboard", "127.0.0.1:0"], stdout=subprocess.PIPE, text=True)
        try:
            assert up.stdout is not None
            url = up.stdout.readline().partition("dashboard ")[2].strip().rstrip("/")  # it is ready
            return _ask(url, Path(state), up.pid, options.seconds)
        finally:
            up.terminate()
            up.wait()


def _ask(url: str, state: Path, up: int, seconds: int) -> int:
    with supernode.connect(state) as client:
        client.submit(str(ROOT / "examples" / "rastrigin.toml"), id="a", **_ENDLESS)
    before = _dashboard_below(up)
    asked = subprocess.run(
        [
            *(sys.executable, "-m", "schemathesis.cli", "fuzz", str(_ROUTES), "--url", url),
            *("--checks", "no_internal_error", "--max-time", str(seconds), "--warnings", "off"),
            *("--request-timeout", str(GIVEN_UP_AFTER), "--generation-database", "none"),
            "--no-color",
        ],
        cwd=state,  # where schemathesis keeps its notes
        env=os.environ | {"SCHEMATHESIS_HOOKS": "fuzz.dashboard_checks", "PYTHONPATH": str(ROOT)},
        check=False,
    )
    after, megabytes = _dashboard_below(up), _most_megabytes(before)
    print(f"asked for {seconds} s; the dashboard had at most {megabytes} MB", flush=True)
    if after != before:
        print("the dashboard died, and was replaced", flush=True)
    return 1 if asked.returncode or after != before or megabytes > MOST_MEGABYTES else 0


def _dashboard_below(up: int) -> int:
    """Return the process id of the dashboard that ``supernode up`` keeps running."""
    children = Path(f"/proc/{up}/task").glob("*/children")
    for child in (int(each) for path in children for each in path.read_text().split()):
        if b"supernode.dashboard" in Path(f"/proc/{child}/cmdline").read_bytes():
            return child
    return 0


def _most_megabytes(process: int) -> int:
    """Return the most memory that a process has had; 0 if it has ended."""
    try:
        lines = Path(f"/proc/{process}/status").read_text().splitlines()
    except OSError:
        return 0
    return next(int(line.split()[1]) >> 10 for line in lines if line.startswith("VmHWM"))


if __name__ == "__main__":
    sys.exit(main())
