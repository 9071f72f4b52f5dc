"""Kill the process that launches a cluster at random moments of its start, and print what is left 5 s later.

Usage: python -m benchmarks.launcher_killed [--torus 16x32] [--times 20] [--seconds 5] [--seed 1]

One whole start is timed first. The moments are drawn uniformly from 1.1 times that duration, so some kills come when
the cluster has just become ready. A variable in the environment, inherited from the launcher, identifies the
processes of a cluster. The folder that TMPDIR names identifies its files.
"""

import argparse
import os
import random
import secrets
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

MARK = "SUPERNODE_BENCHMARK_MARK"
_LAUNCHER = """
import signal, sys
import supernode
cluster = supernode.LocalCluster(topology=sys.argv[1])
print(flush=True)
signal.pause()
"""
_LOOK_EVERY = 0.05  # seconds


class Left(NamedTuple):
    """What a killed launcher left behind.

    Attributes:
        running: the number of processes of the cluster at the kill, without the launcher.
        processes: the command names of the processes that still run.
        files: the names of files and folders.
        seconds: from the kill until nothing was left, or until the time limit.
    """

    running: int
    processes: list[str]
    files: list[str]
    seconds: float


class Launcher:
    """A process that launches a cluster. All processes and files of the cluster can be found."""

    def __init__(self, topology: str, folder: Path) -> None:
        self._folder = folder
        self._mark = secrets.token_hex(8)
        self._process = subprocess.Popen(
            [sys.executable, "-c", _LAUNCHER, topology],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            env=os.environ | {MARK: self._mark, "TMPDIR": str(folder)},
        )

    def wait_until_ready(self) -> None:
        """Wait until the launcher reports that the cluster is ready."""
        assert self._process.stdout is not None, "it is a pipe"
        if not self._process.stdout.read(1):
            raise RuntimeError("the cluster did not start")

    def kill(self, within: float) -> Left:
        """Kill the launcher; return what is left when nothing is left, or after ``within`` seconds."""
        running = len(self._processes()) - 1
        self._process.kill()
        killed = time.monotonic()
        self._process.wait()
        while True:
            now = time.monotonic() - killed
            left = Left(running, self._processes(), sorted(path.name for path in self._folder.iterdir()), now)
            if now >= within or not (left.processes or left.files):
                break
            time.sleep(_LOOK_EVERY)
        assert self._process.stdout is not None, "it is a pipe"
        self._process.stdout.close()
        return left

    def _processes(self) -> list[str]:
        """Return the command names of the processes that inherited the mark, without zombies."""
        mark = f"{MARK}={self._mark}".encode()
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            try:
                if mark in (folder / "environ").read_bytes().split(b"\0"):
                    found.append((folder / "comm").read_text().strip())
            except OSError:  # the process has ended, or belongs to another user
                continue
        return found


def seconds_of_a_start(topology: str) -> float:
    """Return the seconds of one whole start of a cluster, including the start of Python."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        began = time.monotonic()
        launcher = Launcher(topology, Path(folder))
        launcher.wait_until_ready()
        took = time.monotonic() - began
        launcher.kill(60.0)
    return took


def killed_after(topology: str, seconds: float, within: float) -> Left:
    """Launch a cluster, kill the launcher after ``seconds``, and return what is left at most ``within`` s later."""
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        launcher = Launcher(topology, Path(folder))
        time.sleep(seconds)
        return launcher.kill(within)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line for each kill; the exit status is 1 if anything was left."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--torus", default="16x32")
    parser.add_argument("--times", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=5.0, help="after which nothing may be left (5)")
    parser.add_argument("--seed", type=int, default=1, help="of the moments (1)")
    options = parser.parse_args(arguments)
    topology, draw = f"torus {options.torus}", random.Random(options.seed)
    whole = seconds_of_a_start(topology)
    print(f"{topology}: ready after {whole:.2f} s\n", flush=True)
    print("| killed after, s | processes then | gone after, s | left: processes | files |\n|---|---|---|---|---|")
    clean = 0
    for _ in range(options.times):
        moment = draw.uniform(0.0, 1.1 * whole)
        left = killed_after(topology, moment, options.seconds)
        is_clean = not (left.processes or left.files)
        clean += is_clean
        gone = f"{left.seconds:.2f}" if is_clean else "-"
        print(f"| {moment:.2f} | {left.running} | {gone} | {len(left.processes)} | {len(left.files)} |", flush=True)
    print(f"\nnothing left after {options.seconds:g} s: {clean} of {options.times}")
    return 0 if clean == options.times else 1


if __name__ == "__main__":
    sys.exit(main())
