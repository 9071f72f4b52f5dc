"""Measure the latency of jobs and deadlines on a running cluster, and the resources that its processes keep.

Usage: python -m benchmarks.service [--jobs 1000] [--torus 4x4] [--settled 200] [--deadlines 100] [--database URL]

The cluster is a real one, `supernode up`, in a state folder of its own. One client submits jobs one after another; each
is `examples/arm-ik.toml` with a different seed. Times count from the call of `submit` until the client receives the
publication: *running* is the beginning of the first epoch, *first answer* the first verified improvement. Memory is the
private part of each process, which no other process shares.

Deadlines are measured with jobs on all nodes that find nothing. The lateness is the time from a job's deadline, counted
from its acceptance, until the client receives the end of the job.
"""

import argparse
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import supernode
from coordinator.jobs.states import ENDS
from supernode import Client
from wire import sessions
from wire.callbacks import direct
from wire.jobs import JobState
from wire.news import Improvement

_FILE = Path(__file__).resolve().parents[1] / "examples" / "arm-ik.toml"
_WITHIN = 60.0  # seconds
_DEADLINE = 0.3  # seconds
_PROMPT = 0.05  # seconds
_KILOBYTE = 1024
_COLUMNS = ("descriptors", "threads", "sockets", "private memory, MB")


class Held(NamedTuple):
    """The resources of a process, or of several together."""

    descriptors: int
    threads: int
    sockets: int
    memory: int  # bytes


class Measured(NamedTuple):
    """The measurements of a series of jobs.

    Attributes:
        running: seconds of each job from `submit` until it ran.
        answers: seconds of each job from `submit` until its first answer.
        late: seconds between the deadline and the end of each job that has a deadline.
        ends: how often each job's end was published, by the job's id.
        settled: the resources of each process after the first jobs.
        held: the resources of each process at the end.
    """

    running: list[float]
    answers: list[float]
    late: list[float]
    ends: dict[str, int]
    settled: dict[str, Held]
    held: dict[str, Held]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--jobs", type=int, default=1000)
    parser.add_argument("--torus", default="4x4", help="RxC")
    parser.add_argument("--settled", type=int, default=200, help="jobs after which nothing should grow any more")
    parser.add_argument("--deadlines", type=int, default=100, help="jobs that end by one")
    parser.add_argument("--database", help="URL, instead of a file")
    options = parser.parse_args()
    sizes = options.jobs, options.settled, options.deadlines
    show(measure(*sizes, f"torus {options.torus}", options.database))


def show(measured: Measured) -> None:
    """Print the measurements as tables."""
    lost = sum(times != 1 for times in measured.ends.values())
    print(f"{len(measured.ends)} jobs, {lost} lost or doubled")
    for name, seconds in (("running", measured.running), ("first answer", measured.answers)):
        worst = statistics.quantiles(seconds, n=20)[-1]
        print(f"submit to {name}: median {_ms(statistics.median(seconds))} ms, 95 % within {_ms(worst)} ms")
    prompt = sum(seconds <= _PROMPT for seconds in measured.late) / max(1, len(measured.late))
    print(
        f"{len(measured.late)} deadlines: {prompt:.0%} within {_ms(_PROMPT)} ms, "
        f"median {_ms(statistics.median(measured.late))} ms, worst {_ms(max(measured.late))} ms late"
    )
    print("| process | " + " | ".join(_COLUMNS) + " |")
    print("|---" * (len(_COLUMNS) + 1) + "|")
    for name in [*measured.held, "all"]:
        before, after = (_of(name, each) for each in (measured.settled, measured.held))
        figures = [f"{one} → {two}" for one, two in zip(before[:3], after[:3], strict=True)]
        growth = after.memory / before.memory - 1
        print(
            f"| {name} | {' | '.join(figures)} | {before.memory / 1e6:.2f} → {after.memory / 1e6:.2f} ({growth:+.1%}) |"
        )


def measure(jobs: int, settled: int, deadlines: int, topology: str, database: str | None = None) -> Measured:
    """Start a cluster and submit jobs; measure its processes after ``settled`` jobs and at the end."""
    words = () if database is None else ("--database", database)
    with tempfile.TemporaryDirectory() as folder, up(Path(folder), topology, *words) as process:
        with supernode.connect(folder) as client:
            row = _Row(client, Path(folder), topology)
            row.submit(0, settled)
            before = held_by(process)
            row.submit(settled, jobs)
            after = held_by(process)
            late = [row.late(number) for number in range(deadlines)]
            row.close()
        return Measured(row.running, row.answers, late, row.ends, before, after)


class _Row:
    """Submits jobs one after another and records the publications about them."""

    def __init__(self, client: Client, folder: Path, topology: str) -> None:
        from supernode.client.cluster_info import read_info
        from wire.keys import Keys

        info = read_info(folder)
        self.running: list[float] = []
        self.answers: list[float] = []
        self.ends: dict[str, int] = {}
        self._client = client
        self._file = supernode.load(_FILE).with_run(topology=topology)
        self._ended: dict[str, float] = {}
        self._heard: dict[str | int, float] = {}
        self._numbers: dict[str, int] = {}
        self._session = sessions.client(info.endpoint)
        self._session.declare_subscriber(Keys(info.cluster).state, direct(self._hear_state))
        self._session.declare_subscriber(Keys(info.cluster).best, direct(self._hear_best))

    def submit(self, first: int, last: int) -> None:
        for number in range(first, last):
            name = f"job-{number}"
            self.ends[name] = 0
            began = time.monotonic()
            job = self._client.submit(self._file, id=name, seed=number + 1)
            job.end(_WITHIN)
            self.running.append(self._heard.get(name, began + _WITHIN) - began)
            self.answers.append(self._heard.get(self._numbers.get(name, -1), began + _WITHIN) - began)

    def late(self, number: int) -> float:
        """Return the seconds between the deadline and the end of a job that finds nothing."""
        name = f"deadline-{number}"
        job = self._client.submit(self._file, id=name, seed=number, target=-1.0, stall=10**9, seconds=_DEADLINE)
        accepted = time.monotonic() - (time.time() - job.show()["submitted"])
        job.end(_WITHIN)
        return self._ended[name] - accepted - _DEADLINE

    def close(self) -> None:
        self._session.close()  # type: ignore[no-untyped-call]

    def _hear_state(self, sample: object) -> None:
        state = JobState.decode(sample.payload.to_bytes())  # type: ignore[attr-defined]
        self._numbers[state.job] = state.number
        if state.status == "running":
            self._heard.setdefault(state.job, time.monotonic())
        elif state.status in ENDS:
            self._ended[state.job] = time.monotonic()
            self.ends[state.job] = self.ends.get(state.job, 0) + 1

    def _hear_best(self, sample: object) -> None:
        better = Improvement.decode(sample.payload.to_bytes())  # type: ignore[attr-defined]
        self._heard.setdefault(better.job, time.monotonic())


@contextmanager
def up(folder: Path, topology: str, *words: str) -> Iterator[int]:
    """Run `supernode up` with further words while the context is open; yield its process id when it is ready."""
    command = [sys.executable, "-m", "supernode", "up", "--topology", topology, "--state", str(folder), *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
    finally:
        process.terminate()
        process.wait()


def held_by(process: int) -> dict[str, Held]:
    """Return the resources of a cluster's processes, by name, nodes together. ``process`` is that of `supernode up`."""
    zygotes = _children(process)
    found: dict[str, Held] = {}
    for each in [process, *zygotes, *(child for zygote in zygotes for child in _children(zygote))]:
        name = Path(f"/proc/{each}/comm").read_text(encoding="ascii").strip().removeprefix("sn ")
        name = "nodes" if name.startswith("node ") else "up" if each == process else name
        name = "zygote" if each in zygotes else name
        held = _held(each)
        found[name] = held if name not in found else _sum([found[name], held])
    return found


def _of(name: str, found: dict[str, Held]) -> Held:
    return _sum(list(found.values())) if name == "all" else found[name]


def _sum(parts: list[Held]) -> Held:
    return Held(*(sum(part[place] for part in parts) for place in range(4)))


def _held(process: int) -> Held:
    folder = Path(f"/proc/{process}")
    links = []
    for each in (folder / "fd").iterdir():
        try:
            links.append(str(each.readlink()))
        except OSError:  # the descriptor was closed meanwhile
            continue
    rollup = (folder / "smaps_rollup").read_text(encoding="ascii").splitlines()
    private = sum(int(line.split()[1]) * _KILOBYTE for line in rollup if line.startswith("Private_"))
    sockets = sum(link.startswith("socket:") for link in links)
    return Held(len(links), len(list((folder / "task").iterdir())), sockets, private)


def _children(process: int) -> list[int]:
    text = Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii")
    return [int(each) for each in text.split()]


def _ms(seconds: float) -> str:
    return f"{seconds * 1e3:.0f}"


if __name__ == "__main__":
    main()
