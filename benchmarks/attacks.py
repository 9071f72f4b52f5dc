"""Measure what attacks on a cluster with keys cost a client who does nothing wrong.

Usage: python -m benchmarks.attacks [--jobs 60] [--torus 4x4] [--only NAME]

A cluster listens by TLS on loopback. A client submits one job after another; each is `examples/arm-ik.toml` with a seed
of its own. The table compares the times from `submit` to the result, without an attack and under it, in turns. Each
result must have the history that a simulation has.

The attackers are processes that yield the processors to the cluster (nice 19), since those of real ones are elsewhere.
"""

import argparse
import os
import resource
import signal
import socket
import ssl
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

import zenoh

import supernode
from benchmarks.access_matrix import authority
from benchmarks.service import up
from supernode.deploy.addresses import free_port
from supernode.files.authority import Authority
from wire import sessions
from wire.callbacks import direct
from wire.jobs import ListJobs, encode
from wire.keys import Keys
from wire.members import Identity

_FILE = Path(__file__).resolve().parents[1] / "examples" / "arm-ik.toml"
_GOOD = "robot"  # the client that is measured
_WITHIN = 60.0  # seconds
_TRIES = 10  # of a new client
_WARM = 2.0  # seconds from an attack's beginning until the client is measured
_FILES = 20_000  # descriptors of an attacker
_LIMITED = "a flood of submits, half of the nodes for each client"


class Attacked(NamedTuple):
    """An attacker's means: the endpoint, the folder of keys, and the cluster's keys of messages."""

    endpoint: str
    folder: Path
    keys: Keys

    @property
    def address(self) -> tuple[str, int]:
        """Return host and port of the endpoint."""
        host, _, port = self.endpoint.partition("/")[2].rpartition(":")
        return host, int(port)

    def session(self, member: str) -> zenoh.Session:
        """Return a session with a member's keys."""
        return sessions.visitor(self.endpoint, _WITHIN, Identity.read(self.folder / member))


def _stranger(attacked: Attacked) -> None:
    """Shake hands without a certificate, and send bytes that are no handshake."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE  # it has no reason to check
    while True:
        with suppress(OSError), socket.create_connection(attacked.address) as link:
            link.sendall(os.urandom(4096))
        with suppress(OSError), socket.create_connection(attacked.address) as link, context.wrap_socket(link) as secret:
            secret.sendall(os.urandom(4096))


def _refused(name: str) -> Callable[[Attacked], None]:
    """Return an attack by somebody whose certificate is none of the cluster's members."""

    def attack(attacked: Attacked) -> None:
        """Try to open sessions, without end."""
        while True:
            with suppress(zenoh.ZError):
                sessions.visitor(attacked.endpoint, 0.5, Identity.read(attacked.folder / name)).close()  # type: ignore[no-untyped-call]

    return attack


def _forger(name: str) -> Callable[[Attacked], None]:
    """Return an attack by a member that may not do what it does."""

    def attack(attacked: Attacked) -> None:
        """Publish and ask under keys of others, as fast as possible."""
        keys, session = attacked.keys, attacked.session(name)
        forged = [keys.best, keys.state, keys.spy, keys.node(3), f"{keys.node(3)}/out", keys.requests(_GOOD, "down")]
        while True:
            for key in forged:
                session.put(key, os.urandom(256))
            for _ in session.get(f"{keys.node(3)}/control", payload=b"x", timeout=1.0):
                pass

    return attack


def _gigabytes(attacked: Attacked) -> None:
    """Send messages of 1 GiB, in the cluster's protocol and as bytes before any."""
    session = attacked.session("client")
    key, huge = attacked.keys.requests("client", "submit"), bytes(1 << 30)
    while True:
        with suppress(zenoh.ZError):
            session.put(key, huge, congestion_control=zenoh.CongestionControl.BLOCK)
        with suppress(OSError), socket.create_connection(attacked.address) as link:
            link.sendall(memoryview(huge))


def _connections(attacked: Attacked) -> None:
    """Hold 10,000 connections, and open anew what is closed."""
    resource.setrlimit(resource.RLIMIT_NOFILE, (_FILES, _FILES))
    kept: list[socket.socket] = []
    while True:
        with suppress(OSError):
            kept.append(socket.create_connection(attacked.address, timeout=1.0))
        if len(kept) > 10_000:
            kept.pop(0).close()


def _slow_readers(attacked: Attacked) -> None:
    """Ask as twenty clients for more than their links hold, and then do not read: stop the process."""
    for _ in range(20):
        session = attacked.session("client")
        for key in (attacked.keys.best, attacked.keys.state, attacked.keys.log):
            session.declare_subscriber(key, direct(lambda _: None))
        for _ in range(300):
            session.get(
                attacked.keys.requests("client", "watch"),
                direct(lambda _: None),
                payload=encode(ListJobs()),
                timeout=_WITHIN,
            )
    os.kill(os.getpid(), signal.SIGSTOP)


def _submits(attacked: Attacked) -> None:
    """Submit jobs as one client, as fast as four threads can."""

    def submit(first: int) -> None:
        problem = supernode.load(_FILE)
        with supernode.connect(attacked.endpoint, keys=attacked.folder / "client") as client:
            for number in range(first, sys.maxsize, 4):
                with suppress(supernode.ClusterFailed, supernode.BadInput):
                    client.submit(problem, id=f"flood-{number}", seed=number)

    threads = [threading.Thread(target=submit, args=(first,)) for first in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


ATTACKS: dict[str, Callable[[Attacked], None]] = {
    "a stranger": _stranger,
    "a foreign authority's certificate": _refused("foreign"),
    "an expired certificate": _refused("expired"),
    "a spy's certificate, forging": _forger("spy"),
    "a watcher's certificate, forging": _forger("watcher"),
    "a revoked client, forging": _forger("revoked"),
    "messages of 1 GiB": _gigabytes,
    "10,000 connections": _connections,
    "20 slow readers": _slow_readers,
    "a flood of submits": _submits,
    _LIMITED: _submits,
}


class _Client:
    """The client that does nothing wrong."""

    def __init__(self, client: supernode.Client, topology: str, jobs: int) -> None:
        self._client = client
        problem = supernode.load(_FILE).with_run(topology=topology)
        self._problems = [problem.with_run(seed=seed) for seed in range(1, jobs + 1)]
        self._expected = [supernode.simulate(each).history_sha256 for each in self._problems]

    def turn(self) -> tuple[list[float], int]:
        """Run all jobs; return the seconds that each took, and how many had the same result as a simulation."""
        seconds, same = [], 0
        for problem, expected in zip(self._problems, self._expected, strict=True):
            began = time.monotonic()
            result = self._client.submit(problem).result(_WITHIN)
            seconds.append(time.monotonic() - began)
            same += result.history_sha256 == expected
        return seconds, same


@contextmanager
def _under(name: str, endpoint: str, folder: Path) -> Iterator[None]:
    """Attack while the context is open."""
    words = ["--attack", name, "--connect", endpoint, "--keys", str(folder)]
    with subprocess.Popen([sys.executable, "-m", "benchmarks.attacks", *words], stdout=subprocess.PIPE) as process:
        try:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(_WARM)
            yield
            assert process.poll() is None, "the attacker has ended by itself"
        finally:
            process.kill()


def measure(options: argparse.Namespace) -> None:
    """Print the table."""
    times = "median, ms: quiet, attacked | 95 %, ms: quiet, attacked | 95 %: attacked ÷ quiet"
    print(f"| attack | {times} | same result | a new client's first answer, ms: quiet, attacked |")
    print("|---|---:|---:|---:|---:|---:|", flush=True)
    with authority() as folder:
        Authority(folder).add(_GOOD, "client", ("watch", "submit"), 1.0, ())
        topology = f"torus {options.torus}"
        for name in [options.only] if options.only else ATTACKS:
            # A new cluster each time: some attacks have an effect afterwards.
            endpoint = f"tls/127.0.0.1:{free_port()}"
            with (
                tempfile.TemporaryDirectory() as state,
                up(Path(state), *_cluster(name, options.torus), "--keys", str(folder), "--listen", endpoint),
                supernode.connect(endpoint, keys=folder / _GOOD) as connected,
            ):
                client = _Client(connected, topology, options.jobs)
                client.turn()
                quiet, _ = client.turn()
                news = [_new_client(endpoint, folder)]
                with _under(name, endpoint, folder):
                    attacked, same = client.turn()
                    news.append(_new_client(endpoint, folder))
                print(f"{_row(name, quiet, attacked, same)} {', '.join(news)} |", flush=True)


def _cluster(attack: str, torus: str) -> list[str]:
    """Return the topology of the cluster that is attacked, and its options: nodes for one job, or for one of each."""
    if attack != _LIMITED:
        return [f"torus {torus}"]
    rows, columns = (int(each) for each in torus.split("x"))
    return [f"torus {2 * rows}x{columns}", "--client-nodes", str(rows * columns)]


def _new_client(endpoint: str, folder: Path) -> str:
    """Connect anew; return the median of some tries in ms, and how many failed if any did."""
    seconds = []
    for _ in range(_TRIES):
        began = time.monotonic()
        with suppress(supernode.ClusterFailed), supernode.connect(endpoint, keys=folder / _GOOD) as client:
            client.status()
            seconds.append(time.monotonic() - began)
    median = f"{statistics.median(seconds) * 1e3:.0f}" if seconds else "never"
    return median if len(seconds) == _TRIES else f"{median} ({_TRIES - len(seconds)} of {_TRIES} failed)"


def _row(name: str, quiet: list[float], attacked: list[float], same: int) -> str:
    medians = [f"{statistics.median(each) * 1e3:.0f}" for each in (quiet, attacked)]
    most = [statistics.quantiles(each, n=20)[-1] for each in (quiet, attacked)]
    mosts = [f"{each * 1e3:.0f}" for each in most]
    return f"| {name} | {', '.join(medians)} | {', '.join(mosts)} | {most[1] / most[0]:.2f} | {same}/{len(attacked)} |"


def main() -> None:
    """Measure, or attack if this is the attacker's process."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--jobs", type=int, default=60, help="of each turn")
    parser.add_argument("--torus", default="4x4", help="RxC")
    parser.add_argument("--only", choices=ATTACKS, help="one attack")
    parser.add_argument("--attack", choices=ATTACKS, help=argparse.SUPPRESS)
    parser.add_argument("--connect", help=argparse.SUPPRESS)
    parser.add_argument("--keys", type=Path, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if not options.attack:
        measure(options)
        return
    os.nice(19)
    with supernode.connect(options.connect, keys=options.keys / "client") as client:
        attacked = Attacked(options.connect, options.keys, client.keys)
    print("begun", flush=True)
    ATTACKS[options.attack](attacked)


if __name__ == "__main__":
    main()
