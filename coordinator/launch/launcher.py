"""The caller's side of the zygote: start it, learn its processes' ids, notice its end, and end it."""

import contextlib
import json
import os
import secrets
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Collection
from dataclasses import asdict, dataclass
from pathlib import Path

import topologies
from coordinator.cpu_time import cpu_seconds_of
from coordinator.errors import ClusterFailed
from coordinator.jobs.checkpoint import CHECKPOINT_EVERY
from coordinator.launch import capacity
from coordinator.launch.folders import new_folder
from coordinator.launch.stopped import NODE_TIMEOUT
from coordinator.threads import ONE_THREAD
from wire.seal import SECRET_BYTES

_END_WITHIN = 60.0  # seconds; a thousand processes end within three, but the machine may be busy
_CROWD = 100
"""The number of nodes from which on the cluster gets sessions of its own.

Linux may share cores out among sessions first (autogroup). So many nodes would leave next to nothing to other processes
of their session; therefore the nodes get a session of their own, and the router, the spy and the coordinator one each.
Fewer nodes stay in the caller's session: on Linux 6.18 small clusters in sessions of their own delay each other much.
"""


@dataclass(frozen=True)
class ServiceOptions:
    """The options of a cluster that stays up: it has a coordinator process, and replaces processes that die.

    Attributes:
        state: the folder of its database. If None, the database is in the folder of the sockets and gone at the end.
        database: the URL of the database, instead of a file in ``state``.
        listen: further endpoints for the router to listen at.
        max_queue: how many jobs of a client may wait; None for any number.
        client_nodes: how many nodes the running jobs of a client may have together; None for any number.
        log_json: see `coordinator.service.process.Options`.
        keep_days, keep_records: see `coordinator.store.record_book.Keep`.
        allow_modules: users' modules whose problems may be run.
        modules: the folder of these modules; if None, the folder that the cluster was started in.
        node_timeout: after how many seconds a process that is stopped counts as dead.
        eval_timeout: how many seconds an evaluation may take for each individual, and how many it may go on once its
            job is stopped; None for any time, and `EVAL_TIMEOUT` once the job is stopped.
        node_memory: how many bytes a node may take for a user's own code; None for any number.
        keys: the router's key folder, if members of the cluster show certificates; see `wire.members`.
        checkpoint_every: seconds from one checkpoint of a job to the next; None for no checkpoints.
        sandbox: whether processes that run users' modules have no network, see `coordinator.launch.sandbox`.
    """

    state: Path | None = None
    database: str | None = None
    listen: tuple[str, ...] = ()
    max_queue: int | None = None
    client_nodes: int | None = None
    log_json: bool | None = None
    keep_days: float = 30.0
    keep_records: int = 1_000_000
    allow_modules: tuple[str, ...] = ()
    modules: Path | None = None
    node_timeout: float = NODE_TIMEOUT
    eval_timeout: float | None = None
    node_memory: int | None = None
    keys: Path | None = None
    checkpoint_every: float | None = CHECKPOINT_EVERY
    sandbox: bool = False


def _ignore(_: str) -> None:
    """Do nothing about a replacement."""


class Launcher:
    """The processes of one local cluster.

    Args:
        cluster: the name of the cluster.
        topology: how the nodes are linked until a job asks for other links.
        on_death: called, on a thread of this object, with the reason why the cluster has failed; with None if a client
            has ended it.
        service: options of a cluster that stays up; None for one that ends with its caller.
        kinds: the built-in kinds of problem whose kernels the processes load; None for all.
        force: start it even if this machine cannot hold so many nodes.
        on_replacement: called, likewise, with who has died and how, after another process has taken its place; None if
            the first death is to end the cluster.
        node_timeout, eval_timeout, node_memory: see `ServiceOptions`, for a cluster without them.

    Raises:
        BadInput: if this machine cannot hold so many nodes; the message says how many it can hold.

    Attributes:
        folder: the private folder of the Unix sockets; the zygote makes it, and it is removed when the cluster ends.
        secret: the cluster's secret; see `wire.seal`.
        processes: name ("router", "spy", "node 7") to process id; complete once ``started`` is set.
        started: set when all processes are forked, and also when that has failed.
    """

    def __init__(
        self,
        cluster: str,
        topology: str,
        on_death: Callable[[str | None], None],
        service: ServiceOptions | None = None,
        *,
        kinds: Collection[str] | None = None,
        force: bool = False,
        on_replacement: Callable[[str], None] | None = _ignore,
        node_timeout: float = NODE_TIMEOUT,
        eval_timeout: float | None = None,
        node_memory: int | None = None,
    ) -> None:
        nodes = topologies.parse(topology).cells
        capacity.check(nodes, force=force)
        self.folder = new_folder()
        self.secret = secrets.token_bytes(SECRET_BYTES)
        self.processes: dict[str, int] = {}
        self.started = threading.Event()
        self._on_death = on_death
        self._on_replacement = on_replacement
        self._closing = False
        told = None if service is None else asdict(service) | {"state": (service.state or self.folder).absolute()}
        config = {
            "cluster": cluster,
            "secret": self.secret.hex(),
            "topology": topology,
            "folder": self.folder,
            "service": told,
            "kinds": None if kinds is None else sorted(kinds),
            "replaces": on_replacement is not None,
            "node_timeout": node_timeout if service is None else service.node_timeout,
            "limits": [eval_timeout, node_memory] if service is None else [service.eval_timeout, service.node_memory],
        }
        crowded = nodes >= _CROWD
        self._zygote = subprocess.Popen(
            [sys.executable, "-P", "-m", "coordinator.launch.zygote"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | ONE_THREAD,
            start_new_session=crowded,  # see `_CROWD`
            process_group=None if crowded else 0,  # a terminal's Ctrl-C goes to the caller's group only
        )
        assert self._zygote.stdin is not None, "it is a pipe"
        with contextlib.suppress(BrokenPipeError):  # if the zygote has ended, the reader notices
            # Not as an argument, which every user of the machine could read: this holds a secret, perhaps a password.
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
                if event["died"] is not None and self._on_replacement is not None:
                    self._on_replacement(event["died"])
            elif not self._closing:
                self._on_death(None if "down" in event else event["failed"])
                self._closing = True  # the end of the output follows, and is no further death
        if not self._closing:
            self._on_death("the zygote ended")
        self.started.set()  # if it failed before: nobody must wait for ever

    def cpu_seconds(self) -> float:
        """Return the CPU time that all running processes have used so far, this one included."""
        return sum(self.cpu_seconds_by_process().values())

    def cpu_seconds_by_process(self) -> dict[str, float]:
        """Return the CPU time by name: of each of ``processes``, of "zygote", and of "coordinator" (this process)."""
        return cpu_seconds_of(self.processes | {"zygote": self._zygote.pid}) | {"coordinator": time.process_time()}

    def close(self) -> None:
        """End every process and wait until they are gone. Idempotent.

        Raises:
            ClusterFailed: if they do not end in time; the zygote is killed then, and the kernel kills its children.
        """
        self._closing = True
        if self._zygote.stdin is not None and not self._zygote.stdin.closed:
            self._zygote.stdin.close()  # the lifeline: the zygote ends everything now
        try:
            self._zygote.wait(_END_WITHIN)
        except subprocess.TimeoutExpired as error:
            self._zygote.kill()
            self._zygote.wait()
            raise ClusterFailed("the zygote did not end by itself") from error
        finally:
            self._reader.join()
            shutil.rmtree(self.folder, ignore_errors=True)  # if the zygote was killed
