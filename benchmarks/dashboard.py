"""Measure what watching costs a cluster, with and without a dashboard in pairs, and what the watchers use.

Usage: python -m benchmarks.dashboard [--torus 32x32] [--turns 5] [--seconds 60] [--minutes 30]

One job runs all the time, in lockstep, with a fitness that costs nothing, so nodes do nothing but exchange. Windows of
time alternate within that run: alone, watched, alone, watched. Watched windows alternate between two kinds of watchers:

- *browsers*: a dashboard as `supernode up` keeps it, open in two headless Chromium, one at the cluster's page and one
  at the job's. They compute on the same cores as the nodes, which users' browsers seldom do.
- *readers*: the same dashboard, and two plain HTTP clients in this process that read the stream of events and draw
  nothing. This measures the dashboard alone.

Each watched window is compared with the mean of the windows before and after it. *Generations/s* are the root's, as the
spy reports them. *Per CPU second* divides by the CPU time of router, coordinator, spy and nodes, so it does not show
that other processes took the cores. At the end a dashboard stays open in both browsers for ``--minutes``, and its
memory and the spy's (proportional set size) are printed each minute.
"""

import argparse
import contextlib
import http.client
import os
import shutil
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import supernode
from benchmarks.service import up
from coordinator.cpu_time import cpu_seconds_of
from problems.file import parse
from supernode.client.cluster_info import ClusterInfo, read_info
from supernode.dashboard.keeper import Keeper
from supernode.dashboard.listen_address import ListenAddress
from wire import sessions
from wire.callbacks import direct
from wire.keys import Keys
from wire.news import Statistics

_PROBLEM = 'kind = "function"\nname = "rastrigin"\ndimension = 32\n'
_ENDLESS: dict[str, Any] = {"target": -1.0, "generations": (1 << 31) - 1}
_SETTLED = 10.0  # seconds before a window, because a dashboard takes some to start
_CLUSTER = ("router", "coordinator", "spy", "nodes")
_WATCHERS = ("dashboard", "browsers")
_MINUTE = 60.0

Watch = Callable[[str], AbstractContextManager[None]]


@dataclass(frozen=True)
class Window:
    """The measurements of one window of time.

    Attributes:
        cores: how many cores each kind of process used, on average.
    """

    generations_per_second: float
    cores: dict[str, float]

    @property
    def per_cpu_second(self) -> float:
        """Return the generations for each second of CPU time of the cluster's processes."""
        return self.generations_per_second / sum(self.cores.get(name, 0.0) for name in _CLUSTER)


def main() -> None:
    """Print the windows, the ratios of pairs, and memory over time."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--torus", default="32x32", help="RxC (32x32)")
    parser.add_argument("--turns", type=int, default=5, help="windows watched in each way (5)")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each window (60)")
    parser.add_argument("--minutes", type=float, default=30.0, help="of watching for memory's sake (30)")
    options = parser.parse_args()
    with _Bench(f"torus {options.torus}") as bench:
        compare(bench, options.turns, options.seconds)
        watch_memory(bench, options.minutes)


def compare(bench: "_Bench", turns: int, seconds: float) -> None:
    """Alternate the windows, print each one when it ends, and print the ratios at the end."""
    ways: dict[str, Watch] = {"browsers": bench.browsers, "readers": bench.readers}
    names = ("generations/s", "per CPU second", "spy", *_WATCHERS)
    print("| window | " + " | ".join(name if "/" in name or " " in name else f"{name}, cores" for name in names) + " |")
    print("|---" * (len(names) + 1) + "|")
    pairs: dict[str, list[tuple[Window, Window, Window]]] = {way: [] for way in ways}
    before = _told("alone", bench.window(seconds))
    for _ in range(turns):
        for way, watched in ways.items():
            with bench.watched(watched):
                during = _told(way, bench.window(seconds))
            after = _told("alone", bench.window(seconds))
            pairs[way].append((before, during, after))
            before = after
    for way, windows in pairs.items():
        print(f"{way}, watched over alone: {_ratios(windows)}")


def _told(name: str, window: Window) -> Window:
    cores = (f"{window.cores.get(each, 0.0):.3f}" for each in ("spy", *_WATCHERS))
    figures = (f"{window.generations_per_second:.2f}", f"{window.per_cpu_second:.2f}", *cores)
    print(f"| {name} | {' | '.join(figures)} |", flush=True)
    return window


def _ratios(pairs: list[tuple[Window, Window, Window]]) -> str:
    said = []
    for name, figure in (
        ("generations/s", lambda window: window.generations_per_second),
        ("generations per CPU second", lambda window: window.per_cpu_second),
    ):
        ratios = [2.0 * figure(during) / (figure(one) + figure(other)) for one, during, other in pairs]
        said.append(f"{name} × {statistics.median(ratios):.3f} (from {min(ratios):.3f} to {max(ratios):.3f})")
    return "; ".join(said)


def watch_memory(bench: "_Bench", minutes: float) -> None:
    """Keep a dashboard open in both browsers for ``minutes``, and print memory each minute."""
    print("| minute | spy, MB | dashboard, MB | spy, cores | dashboard, cores |\n|---|---|---|---|---|")
    with bench.watched(bench.browsers):
        began = time.monotonic()
        while True:
            window = bench.window(min(_MINUTE, minutes * 60.0))
            memory = " | ".join(f"{bench.memory(name) / 1e6:.1f}" for name in ("spy", "dashboard"))
            cores = " | ".join(f"{window.cores[name]:.3f}" for name in ("spy", "dashboard"))
            minute = (time.monotonic() - began) / 60.0
            print(f"| {minute:.1f} | {memory} | {cores} |", flush=True)
            if minute >= minutes:
                return


class _Bench:
    """A cluster with a job that does not end, and the watchers of it."""

    def __init__(self, topology: str) -> None:
        self._topology = topology
        self._stack = ExitStack()
        self._told: list[tuple[float, int]] = []  # times, and the root's generation at each
        self._job = ""

    def __enter__(self) -> "_Bench":
        with ExitStack() as stack:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            self._up = stack.enter_context(up(folder, self._topology))
            self._info = read_info(folder)
            self._job = _submitted(folder, self._topology)
            self._listen(self._info, stack)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def _listen(self, info: ClusterInfo, stack: ExitStack) -> None:
        def hear(sample: Any) -> None:
            self._told.append((time.monotonic(), Statistics.decode(sample.payload.to_bytes()).generation))

        session = sessions.client(info.endpoint)
        stack.callback(session.close)
        session.declare_subscriber(Keys(info.cluster).spy_stats, direct(hear))

    # Watching ---------------------------------------------------------------------------------------------------------
    @contextmanager
    def watched(self, how: Watch) -> Iterator[None]:
        """Run a dashboard, watched as ``how`` says, while the context is open."""
        keeper = Keeper(ListenAddress("127.0.0.1", 0), single=False)
        try:
            keeper.start(self._info.endpoint)
            with how(keeper.address):
                yield
        finally:
            keeper.close()

    @contextmanager
    def browsers(self, address: str) -> Iterator[None]:
        """Open two browsers, each with a page, while the context is open."""
        from playwright.sync_api import sync_playwright

        with sync_playwright() as playwright, ExitStack() as stack:
            for page in ("", f"jobs/{self._job}"):
                browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
                stack.callback(browser.close)
                opened = browser.new_page(viewport={"width": 1280, "height": 800})
                opened.goto(address + page)
                opened.wait_for_selector("#link[data-state=answers]", timeout=60_000)
            yield

    @contextmanager
    def readers(self, address: str) -> Iterator[None]:
        """Run two clients that read the stream and discard it, while the context is open."""
        ended = threading.Event()
        threads = [threading.Thread(target=_read, args=(address, ended)) for _ in range(2)]
        for thread in threads:
            thread.start()
        try:
            yield
        finally:
            ended.set()
            for thread in threads:
                thread.join()

    # Measuring --------------------------------------------------------------------------------------------------------
    def window(self, seconds: float) -> Window:
        """Wait until the cluster has settled, then measure for ``seconds``."""
        time.sleep(_SETTLED)
        first, began, used = self._next_statistics(), time.monotonic(), self._cpu_seconds()
        time.sleep(seconds)
        last, took = self._next_statistics(), time.monotonic() - began
        now = self._cpu_seconds()
        cores = {name: (now[name] - used.get(name, 0.0)) / took for name in now}
        return Window((last[1] - first[1]) / (last[0] - first[0]), cores)

    def memory(self, name: str) -> float:
        """Return the memory of a kind of process, bytes: the sum of the proportional set sizes."""
        total = 0
        for process in self._processes()[name]:
            with contextlib.suppress(OSError):
                rollup = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="ascii").splitlines()
                total += sum(int(line.split()[1]) * 1024 for line in rollup if line.startswith("Pss:"))
        return total

    def _next_statistics(self) -> tuple[float, int]:
        seen = len(self._told)
        while len(self._told) == seen:
            time.sleep(0.01)
        return self._told[-1]

    def _cpu_seconds(self) -> dict[str, float]:
        return {
            kind: sum(cpu_seconds_of({str(each): each for each in processes}).values())
            for kind, processes in self._processes().items()
        }

    def _processes(self) -> dict[str, list[int]]:
        """Return the ids of the processes that run now, by kind."""
        found: dict[str, list[int]] = {}
        for process in _descendants(self._up):
            name = _text(process, "comm").strip().removeprefix("sn ")
            found.setdefault("nodes" if name.startswith("node ") else name, []).append(process)
        others = set(_descendants(os.getpid())) - set(_descendants(self._up)) - {self._up}
        for process in others:
            kind = "dashboard" if "supernode.dashboard" in _text(process, "cmdline") else "browsers"
            found.setdefault(kind, []).append(process)
        return found


def _read(address: str, ended: threading.Event) -> None:
    """Read the stream of events until ``ended`` is set; connect again if the dashboard is not ready."""
    host = address.removeprefix("http://").rstrip("/")
    while not ended.is_set():
        connection = http.client.HTTPConnection(host, timeout=5.0)
        with contextlib.closing(connection), contextlib.suppress(OSError, http.client.HTTPException):
            connection.request("GET", "/events")
            answer = connection.getresponse()
            while not ended.is_set() and answer.read1(1 << 16):
                pass


def _submitted(folder: Path, topology: str) -> str:
    """Submit the job and return its id when it runs."""
    with supernode.connect(folder) as client:
        job = client.submit(parse(_PROBLEM, "benchmark", Path()).with_run(topology=topology, **_ENDLESS))
        next(job.improvements())
        return job.id


def _descendants(process: int) -> list[int]:
    """Return the ids of all descendants of a process, whichever thread started them."""
    found = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        with contextlib.suppress(OSError):
            for child in map(int, task.read_text(encoding="ascii").split()):
                found += [child, *_descendants(child)]
    return found


def _text(process: int, name: str) -> str:
    try:
        return Path(f"/proc/{process}/{name}").read_text(errors="replace").replace("\0", " ")
    except OSError:
        return ""


if __name__ == "__main__":
    main()
