"""The caller's side of the zygote: start it, hear of its processes, and end it."""

import contextlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

import topologies
from coordinator import capacity
from coordinator.errors import ClusterFailed
from coordinator.folders import new_folder
from coordinator.threads import ONE_THREAD
from wire.seal import SECRET_BYTES

_END_WITHIN = 60.0  # seconds: a thousand processes are gone in three, but machines may be busy
_CROWD = 100
"""Nodes. As many would leave next to nothing of the cores to others of their session. So, where Linux shares cores out
among sessions first (autogroup), the nodes have one of their own, and so have the router, the spy and the coordinator.
Fewer nodes do better in the caller's: on Linux 6.18 small clusters in many sessions keep each other waiting for long.
"""


@dataclass(frozen=True)
class ServiceOptions:
    """How a cluster that stays up is run: with a coordinator process, and new processes for those that die.

    Attributes:
        state: the folder where it keeps what it must not forget; None: beside its sockets, and gone when it ends.
        database: the URL of its jobs' database, instead of a file in ``state``.
        listen: further endpoints of the router.
        max_queue: how many jobs may wait.
        log_json: see `coordinator.service.Options`.
        keep_days, keep_records: see `coordinator.record_book.Keep`.
        allow_modules: of users, whose problems may be run.
        modules: the folder where these lie, if not the one that it was started in.
    """

    state: Path | None = None
    database: str | None = None
    listen: tuple[str, ...] = ()
    max_queue: int | None = None
    log_json: bool | None = None
    keep_days: float = 30.0
    keep_records: int = 1_000_000
    allow_modules: tuple[str, ...] = ()
    modules: Path | None = None


class Launcher:
    """The processes of one local cluster.

    Args:
        cluster: its name.
        topology: how nodes are linked until a job says otherwise.
        on_death: called with why the cluster is no use any more, or with None if a client has ended it.
        service: for a cluster that stays up.
        force: start it even if this machine cannot hold so many nodes.

    Raises:
        BadInput: if it cannot; says how many it can.

    Attributes:
        folder: private, holds the Unix sockets; the zygote makes it, and it is gone when the cluster has ended.
        secret: of the cluster; see `wire.seal`.
        processes: name ("router", "spy", "node 7") to process id; complete once ``started`` is set.
    """

    def __init__(
        self,
        cluster: str,
        topology: str,
        on_death: Callable[[str | None], None],
        service: ServiceOptions | None = None,
        *,
        force: bool = False,
    ) -> None:
        nodes = topologies.parse(topology).cells
        capacity.check(nodes, force=force)
        self.folder = new_folder()
        self.secret = secrets.token_bytes(SECRET_BYTES)
        self.processes: dict[str, int] = {}
        self.started = threading.Event()
        self._on_death = on_death
        self._closing = False
        told = None if service is None else asdict(service) | {"state": (service.state or self.folder).absolute()}
        config = {
            "cluster": cluster,
            "secret": self.secret.hex(),
            "topology": topology,
            "folder": self.folder,
            "service": told,
        }
        crowded = nodes >= _CROWD
        self._zygote = subprocess.Popen(
            [sys.executable, "-P", "-m", "coordinator.zygote"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
            start_new_session=crowded,  # see `_CROWD`
            process_group=None if crowded else 0,  # Ctrl-C is the caller's business
        )
        assert self._zygote.stdin is not None, "it is a pipe"
        with contextlib.suppress(BrokenPipeError):  # the reader sees that it has ended
            # Not as an argument: everybody can read those, and there are a secret and perhaps a database's password.
            self._zygote.stdin.write(json.dumps(config, default=str).encode() + b"\n")
            self._zygote.stdin.flush()
        self._reader = threading.Thread(target=self._read, name="zygote reader", daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._zygote.stdout is not None
        for line in self._zygote.stdout:
            event = json.loads(line)
            if "processes" in event:
                self.processes = event["processes"]
                self.started.set()
            elif not self._closing:
                self._on_death(None if "down" in event else event["failed"])
                self._closing = True
        if not self._closing:
            self._on_death("the zygote ended")
        self.started.set()

    def cpu_seconds(self) -> float:
        """CPU time that the living processes have used so far, this one included."""
        return sum(self.cpu_seconds_by_process().values())

    def cpu_seconds_by_process(self) -> dict[str, float]:
        """The same by name: that of each in ``processes``, "zygote", and "coordinator", which is this one."""
        return cpu_seconds_of(self.processes | {"zygote": self._zygote.pid}) | {"coordinator": time.process_time()}

    def close(self) -> None:
        """End every process and wait until they are gone. Idempotent.

        Raises:
            ClusterFailed: if they do not end.
        """
        self._closing = True
        if self._zygote.stdin is not None and not self._zygote.stdin.closed:
            self._zygote.stdin.close()
        try:
            self._zygote.wait(_END_WITHIN)
        except subprocess.TimeoutExpired as error:
            self._zygote.kill()
            self._zygote.wait()
            raise ClusterFailed("the zygote did not end by itself") from error
        finally:
            self._reader.join()
            shutil.rmtree(self.folder, ignore_errors=True)  # if the zygote was killed


def cpu_seconds_of(processes: Mapping[str, int]) -> dict[str, float]:
    """CPU time that each of the living ``processes``, names with ids, has used so far."""
    used = {}
    for name, process in processes.items():
        with contextlib.suppress(OSError):  # it has ended
            used[name] = time.clock_gettime(_cpu_clock(process))
    return used


def _cpu_clock(process: int) -> int:
    """The clock id of another process's CPU time, as Linux makes it (clock_getcpuclockid(3))."""
    return (~process << 3) | 2
