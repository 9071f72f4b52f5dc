"""Run a peer's script and measure it from outside, in the same way for all: time, CPU, memory, a killed worker.

All processes of a run have a token in their environment, including those that detach themselves. The token serves to
find and measure them and, at the end, to kill them in any state of the run.
"""

import json
import os
import queue
import re
import secrets
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

_TOKEN = "SUPERNODE_PEERS_RUN"
_READY_WITHIN = 90.0  # seconds, for sixteen MPI ranks with many imports on a busy machine
_KILL_AT = 2.0
_WATCHED = 15.0
_LEAVE_WITHIN = 3.0
_PROC = Path("/proc")


class RunFailed(Exception):  # noqa: N818
    """A script printed something unexpected, or nothing; the message says what."""


@dataclass(frozen=True)
class Peer:
    """A row of the tables: a script and its environment."""

    name: str
    environment: str | None  # None: the project's own
    script: str
    variant: str = ""
    ranks: int = 0  # MPI ranks under mpiexec; 0: run without it


class Process:
    """A running script. ``lines`` holds its JSON lines, and None at its end."""

    def __init__(self, command: list[str], token: str, folder: str) -> None:
        self.token = token
        self.shared: set[str] = set()
        self.started = time.monotonic()
        self.popen = subprocess.Popen(
            command,
            cwd=folder,
            env=os.environ | {_TOKEN: token},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            text=True,
            errors="replace",
        )
        self.lines: queue.SimpleQueue[dict | None] = queue.SimpleQueue()
        self.said: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.popen.stdout is not None
        for line in self.popen.stdout:
            if line.startswith("{"):
                self.lines.put(json.loads(line))
            elif line.strip():
                self.said.append(line.strip())
        self.lines.put(None)

    def next_line(self, timeout: float) -> dict:
        """Return the script's next JSON line.

        Raises:
            RunFailed: if the script ends first.
            TimeoutError: if no line arrives in time.
        """
        try:
            line = self.lines.get(timeout=timeout)
        except queue.Empty:
            raise TimeoutError(f"nothing came within {timeout:.0f} s") from None
        if line is None:
            raise RunFailed(self.epitaph())
        return line

    def epitaph(self) -> str:
        """Return how the script ended, and the most informative line of its last output."""
        code = self.popen.wait(5.0)
        how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        telling = [each for each in self.said if re.search(r"error|exception|terminat|kill", each, re.IGNORECASE)]
        words = (telling or self.said or [""])[-1]
        return f"{how}: {words[:100]}" if words and "/" not in words else how

    def members(self) -> list[int]:
        """Return the ids of all processes of the run."""
        mark = f"{_TOKEN}={self.token}".encode()
        return [process for process in _all_processes() if mark in _read_bytes(process, "environ").split(b"\0")]

    def cpu_seconds(self) -> dict[int, float]:
        """Return the CPU seconds of each process so far, with its threads."""
        used = {}
        for process in self.members():
            fields = _read_bytes(process, "stat").rpartition(b")")[2].split()
            if fields:
                used[process] = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
        return used

    def memory(self) -> float:
        """Return the sum of the proportional set sizes, bytes."""
        self._note_shared()
        texts = [_read_bytes(process, "smaps_rollup").decode() for process in self.members()]
        return sum(int(size) * 1024 for text in texts for size in re.findall(r"^Pss:\s+(\d+)", text, re.MULTILINE))

    def end(self) -> None:
        """Let the run end by itself, then kill all processes except resource trackers, then these."""
        self._note_shared()
        for doomed in (lambda _: False, lambda process: not _clears_up(process), lambda _: True):
            deadline = time.monotonic() + _LEAVE_WITHIN
            while (left := self.members()) and time.monotonic() < deadline:
                for process in filter(doomed, left):
                    _kill(process)
                time.sleep(0.02)
        self.popen.wait(10.0)
        for name in self.shared:
            Path(name).unlink(missing_ok=True)

    def _note_shared(self) -> None:
        """Note MPICH's shared-memory files, which no process removes if its owner is killed."""
        for process in self.members():
            maps = _read_bytes(process, "maps").decode(errors="replace")
            self.shared |= set(re.findall(r"/dev/shm/mpich\S+", maps))


def _all_processes() -> list[int]:
    return [int(entry.name) for entry in _PROC.iterdir() if entry.name.isdigit()]


def _read_bytes(process: int, name: str) -> bytes:
    """Read a file of /proc; return nothing if the process has ended."""
    try:
        return (_PROC / str(process) / name).read_bytes()
    except OSError:
        return b""


def _clears_up(process: int) -> bool:
    """Return whether a process is `multiprocessing`'s resource tracker, which removes the others' semaphores."""
    return b"resource_tracker" in _read_bytes(process, "cmdline")


def _kill(process: int) -> None:
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)


def interpreter(peer: Peer, environments: Path) -> Path:
    """Return the Python interpreter that runs the peer's script."""
    return Path(sys.executable) if peer.environment is None else environments / peer.environment / "bin" / "python"


@contextmanager
def running(peer: Peer, environments: Path, setting: dict) -> Iterator[Process]:
    """Run a peer's script in a folder of its own while the context is open; no process or file remains."""
    python = interpreter(peer, environments)
    command = [str(python), str(Path(__file__).with_name(peer.script)), json.dumps(setting | {"variant": peer.variant})]
    if peer.ranks:
        command = [str(python.with_name("mpiexec")), "-n", str(peer.ranks), *command]
    with tempfile.TemporaryDirectory() as folder:
        process = Process(command, secrets.token_hex(8), folder)
        try:
            yield process
        finally:
            process.end()


@dataclass(frozen=True)
class Speed:
    """The measurements of a run without a target."""

    ready: float  # seconds from the command to the first possible generation
    spawn: float | None  # seconds of these for starting the peer's own processes, if known
    evaluations: float  # a second
    generations: float  # a second
    cores: float  # busy


def warm_up(peer: Peer, environments: Path, setting: dict) -> None:
    """Run once without measuring, so that Python and kernels are compiled."""
    with running(peer, environments, setting) as process:
        process.next_line(_READY_WITHIN)
        process.next_line(60.0)


def speed(peer: Peer, environments: Path, setting: dict, seconds: float) -> Speed:
    """Run for ``seconds``; CPU time is measured in the middle of the run."""
    with running(peer, environments, setting | {"seconds": seconds}) as process:
        line = process.next_line(_READY_WITHIN)
        ready = time.monotonic() - process.started
        time.sleep(0.2 * seconds)
        before, began = process.cpu_seconds(), time.monotonic()
        time.sleep(0.6 * seconds)
        after, ended = process.cpu_seconds(), time.monotonic()
        result = process.next_line(seconds + 20.0)
    used = sum(after[each] - before[each] for each in after.keys() & before.keys())
    rates = (result[name] / result["seconds"] for name in ("evaluations", "generations"))
    return Speed(ready, line["spawn"], *rates, used / (ended - began))


@dataclass(frozen=True)
class Search:
    """The measurements of the runs with a target."""

    tried: int
    evaluations: list[int]  # of the runs that reached the target
    seconds: list[float]


def search(peer: Peer, environments: Path, setting: dict, seeds: int, cap: float, budget: float) -> Search:
    """Run once for each seed, at most ``cap`` seconds each; start no run after ``budget`` seconds."""
    over = time.monotonic() + budget
    reached: list[dict] = []
    tried = 0
    while tried < seeds and time.monotonic() < over:
        tried += 1
        with running(peer, environments, setting | {"seed": tried, "seconds": cap}) as process:
            process.next_line(_READY_WITHIN)
            result = process.next_line(cap + 20.0)
        if result["best"] <= setting["target"]:
            reached.append(result)
    return Search(tried, [each["evaluations"] for each in reached], [each["seconds"] for each in reached])


def repeats(peer: Peer, environments: Path, setting: dict) -> bool:
    """Return whether three runs with the same seed and number of generations are equal."""
    results = []
    for _ in range(3):
        with running(peer, environments, setting) as process:
            process.next_line(_READY_WITHIN)
            results.append(process.next_line(60.0))
    return len({(each["best"], each["evaluations"], each.get("history")) for each in results}) == 1


@dataclass(frozen=True)
class Death:
    """The outcome of a run with a killed worker, and its memory and processes just before."""

    outcome: str
    memory: float
    processes: int


def death(peer: Peer, environments: Path, setting: dict) -> Death:
    """Kill the sixth worker (or the last, if there are fewer) two seconds after the start of a longer run."""
    with running(peer, environments, setting) as process:
        workers = process.next_line(_READY_WITHIN)["workers"]
        ready = time.monotonic()
        time.sleep(0.75 * _KILL_AT)
        memory, members = process.memory(), len(process.members())
        if not workers:
            return Death("one process: its end is the run's", memory, members)
        time.sleep(max(0.0, ready + _KILL_AT - time.monotonic()))
        _kill(workers[min(5, len(workers) - 1)])
        return Death(_aftermath(process), memory, members)


def _aftermath(process: Process) -> str:
    killed = time.monotonic()
    try:
        result = process.next_line(_WATCHED)
    except RunFailed as end:
        return f"aborted after {time.monotonic() - killed:.1f} s, {end}"
    except TimeoutError:
        return _hung(process)
    after = f"after {time.monotonic() - killed:.1f} s"
    return (
        f"{after} a clear error: {result['error']}" if "error" in result else f"ended as if nothing had been, {after}"
    )


def _hung(process: Process) -> str:
    before = process.cpu_seconds()
    time.sleep(1.0)
    after = process.cpu_seconds()
    busy = sum(after[each] - before[each] for each in after.keys() & before.keys())
    return f"hung: no end {_WATCHED:.0f} s later, {busy:.1f} cores busy"
