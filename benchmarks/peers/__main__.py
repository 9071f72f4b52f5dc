"""Compare Supernode with other libraries: the same function and population, one after the other on this machine.

Usage: python -m benchmarks.peers [--quick] [--only pygmo,deap]

Each library has an environment of its own under .peers, so none is a dependency of this project. A full run takes a
quarter of an hour and writes its measurements into docs/peers.md. A quick run, or a run of some rows, only prints them.
"""

import argparse
import datetime
import os
import platform
import re
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.peers import measure
from benchmarks.peers.measure import Peer

_ROOT = Path(__file__).resolve().parent.parent.parent
_ENVIRONMENTS = _ROOT / ".peers"
_PAGE = _ROOT / "docs" / "peers.md"
_BEGIN, _END = "<!-- measured by make peers -->", "<!-- end -->"

REQUIREMENTS = {
    "pygmo": ["pygmo>=2.19"],
    "deap": ["deap>=1.4", "numpy>=1.26"],
    "propulate": ["propulate>=1.2", "mpi4py>=4.1", "mpich>=4.2"],
    "pycellga": ["pycellga>=0.4"],
}
PEERS = (
    Peer("Supernode", None, "supernode_torus.py"),
    Peer("pygmo, C++ problem, threads, GA", "pygmo", "pygmo_islands.py", "C++ threads sga"),
    Peer("pygmo, C++ problem, threads, bee colony", "pygmo", "pygmo_islands.py", "C++ threads bees"),
    Peer("pygmo, C++ problem, processes, GA", "pygmo", "pygmo_islands.py", "C++ processes sga"),
    Peer("pygmo, Python problem, processes, GA", "pygmo", "pygmo_islands.py", "Python processes sga"),
    Peer("DEAP, processes", "deap", "deap_islands.py"),
    Peer("propulate, MPI", "propulate", "propulate_islands.py", ranks=16),
    Peer("pycellga", "pycellga", "pycellga_grid.py"),
    Peer("pycellga, optimum not at the origin", "pycellga", "pycellga_grid.py", "moved"),
)
SETTING = {
    "topology": "torus 4x4",
    "islands": 16,
    "deme": 64,
    "interval": 10,
    "dimension": 10,
    "seed": 1,
    "seconds": None,
    "generations": None,
    "target": None,
}
_TARGET = 1e-2
_CAP = 20.0  # seconds of a search
_SAME_SEED_GENERATIONS = 20
_KILLED_RUN = 6.0  # seconds that the run would take undisturbed


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="short measurements, 3 seeds; prints only")
    parser.add_argument("--only", default="", help="rows whose name contains one of these; prints only")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # SystemExit ends the current run's processes
    wanted = [each.lower() for each in options.only.split(",")]
    peers = [peer for peer in PEERS if any(each in peer.name.lower() for each in wanted)]
    began, load = time.monotonic(), os.getloadavg()
    rows = [row(peer, options.quick) for peer in peers]
    text = page(rows, load, time.monotonic() - began)
    print(text)
    if not options.quick and not options.only:
        _put_into_page(text)


def row(peer: Peer, quick: bool) -> dict:
    """Return all measurements of a peer by column; a failed measurement is its error message."""
    print(f"{peer.name}…", file=sys.stderr, flush=True)
    found = {"name": peer.name}
    if (reason := _install(peer.environment)) is not None:
        return found | {"failed": reason}

    def attempt(name: str, measurement: Callable, *arguments: object) -> None:
        try:
            found[name] = measurement(peer, _ENVIRONMENTS, *arguments)
        except (measure.RunFailed, TimeoutError) as error:
            found[name] = str(error)

    attempt("warm-up", measure.warm_up, SETTING | {"generations": SETTING["interval"]})
    attempt("speed", measure.speed, SETTING, 2.0 if quick else 6.0)
    if isinstance(found["speed"], str):
        return found | {"failed": found["speed"]}
    intervals = max(1, round(found["speed"].generations * _KILLED_RUN / SETTING["interval"]))
    attempt("death", measure.death, SETTING | {"generations": intervals * SETTING["interval"]})
    attempt("repeats", measure.repeats, SETTING | {"generations": _SAME_SEED_GENERATIONS})
    limits = (3, 4.0, 10.0) if quick else (20, _CAP, 70.0)
    attempt("search", measure.search, SETTING | {"target": _TARGET}, *limits)
    return found


def _install(environment: str | None) -> str | None:
    """Create a peer's environment if it does not exist; return None, or why that failed."""
    if environment is None:
        return None
    folder = _ENVIRONMENTS / environment
    done = folder / "installed"
    wanted = "\n".join(REQUIREMENTS[environment])
    if done.exists() and done.read_text() == wanted:
        return None
    pip = [str(folder / "bin" / "pip"), "install", "--quiet", "--disable-pip-version-check"]
    for command in ([sys.executable, "-m", "venv", str(folder)], [*pip, *REQUIREMENTS[environment]]):
        try:
            subprocess.run(command, check=True, timeout=300, stdout=subprocess.DEVNULL)
        except subprocess.CalledProcessError as error:
            return f"could not be installed: pip or venv ended with exit code {error.returncode}"
        except subprocess.TimeoutExpired:
            return "could not be installed within 300 s"
    done.write_text(wanted)
    return None


def page(rows: list[dict], load: tuple[float, ...], seconds: float) -> str:
    """Return the generated part of the page: machine, setting, three tables, and a comparison."""
    return "\n".join(
        [
            f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d}: {os.cpu_count()} cores, {_processor()}, Linux"
            f" {platform.release()}, Python {platform.python_version()}. Load at the start"
            f" {', '.join(f'{each:.1f}' for each in load)}; the whole took {seconds / 60:.0f} minutes.",
            "",
            f"Rastrigin, D = {SETTING['dimension']}, within ±5.12; {SETTING['islands']} × {SETTING['deme']}"
            f" = {SETTING['islands'] * SETTING['deme']} individuals;"
            f" one emigrant every {SETTING['interval']} generations.",
            "",
            "| | evaluations/s | generations/s of an island | cores busy | evaluations per CPU second "
            "| ready, s | of which spawning | processes | memory, MB |",
            "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
            *(_speed_line(each) for each in rows),
            "",
            *_claims(rows),
            "| | reached 1e-2 | evaluations, median | seconds, median | seconds, worst |",
            "|---|---:|---:|---:|---:|",
            *(_search_line(each) for each in rows if "failed" not in each),
            "",
            "| | one worker killed at 2 s | same seed three times |",
            "|---|---|---|",
            *(_trust_line(each) for each in rows if "failed" not in each),
            "",
            "Versions: " + "; ".join(_versions()) + ".",
        ]
    )


def _speed_line(found: dict) -> str:
    if "failed" in found:
        return f"| {found['name']} | {found['failed']} | | | | | | | |"
    speed, death = found["speed"], found["death"]
    spawn = "" if speed.spawn is None else f"{speed.spawn:.2f}"
    rest = f"{death} |" if isinstance(death, str) else f"{death.processes} | {death.memory / 1e6:.0f}"
    per_second = f"{speed.evaluations / max(speed.cores, 0.01):,.0f}"
    return (
        f"| {found['name']} | {speed.evaluations:,.0f} | {speed.generations:,.1f} | {speed.cores:.2f} | {per_second}"
        f" | {speed.ready:.2f} | {spawn} | {rest} |"
    )


def _search_line(found: dict) -> str:
    search = found["search"]
    if isinstance(search, str):
        return f"| {found['name']} | {search} | | | |"
    head = f"| {found['name']} | {len(search.seconds)} of {search.tried} |"
    if not search.seconds:
        return f"{head} | | |"
    median = statistics.median(search.seconds)
    return f"{head} {statistics.median(search.evaluations):,.0f} | {median:.2f} | {max(search.seconds):.2f} |"


def _trust_line(found: dict) -> str:
    death, same = found["death"], found["repeats"]
    outcome = death if isinstance(death, str) else death.outcome
    return f"| {found['name']} | {outcome} | {same if isinstance(same, str) else 'the same' if same else 'differ'} |"


def _claims(rows: list[dict]) -> list[str]:
    """Return a line with Supernode's evaluations/s relative to the best peer of each kind."""
    rates = {each["name"]: each["speed"].evaluations for each in rows if "failed" not in each}
    own = rates.pop("Supernode", None)
    kinds = {"C++": "C++ problem", "Python": "Python problem"}
    said = []
    for kind, words in kinds.items():
        others = {name: rate for name, rate in rates.items() if ("C++" in name) == (kind == "C++")}
        if own is not None and others:
            quickest = max(others, key=others.__getitem__)
            said.append(f"{own / others[quickest]:.2f} of the quickest peer with a {words} ({quickest})")
    return [f"Supernode's evaluations/s are {' and '.join(said)}.", ""] if said else []


def _processor() -> str:
    found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found.group(1) if found else platform.machine()


def _versions() -> list[str]:
    """Return the installed versions of each peer."""
    listed = []
    for environment, requirements in REQUIREMENTS.items():
        names = [re.split(r"[<>=]", each)[0] for each in requirements]
        code = f"import importlib.metadata as m; print(*(n + ' ' + m.version(n) for n in {names!r}), sep=', ')"
        python = _ENVIRONMENTS / environment / "bin" / "python"
        if python.exists():
            told = subprocess.run([str(python), "-c", code], capture_output=True, text=True, check=False)
            listed.append(told.stdout.strip() or f"{environment} unknown")
    return listed


def _put_into_page(text: str) -> None:
    """Replace the text between the two marks of the page."""
    before, _, rest = _PAGE.read_text().partition(_BEGIN)
    _PAGE.write_text(f"{before}{_BEGIN}\n\n{text}\n\n{_END}{rest.partition(_END)[2]}")


if __name__ == "__main__":
    main()
