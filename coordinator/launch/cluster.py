"""A cluster of processes on this machine that belongs to the calling process and ends with it."""

import secrets
import threading
import time
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Self

import zenoh

import topologies
from coordinator.errors import ClusterFailed
from coordinator.jobs.checkpoint import CHECKPOINT_EVERY
from coordinator.jobs.dispatcher import Dispatcher
from coordinator.jobs.job import Job, JobSpec
from coordinator.jobs.running import EVAL_TIMEOUT
from coordinator.launch import capacity
from coordinator.launch.compilation import compile_missing
from coordinator.launch.launcher import Launcher
from coordinator.launch.stopped import NODE_TIMEOUT
from coordinator.service.roster import Roster
from coordinator.store.checkpoint_folder import CheckpointFolder
from problems import BadInput, Problem, ProblemFile, registry
from problems.in_memory import file_of
from problems.run import with_topology
from spy.least_improvement import LEAST
from wire import sessions
from wire.callbacks import direct
from wire.keys import Keys
from wire.seal import Seal

_READY_WITHIN = 120.0  # seconds; a thousand nodes on two cores usually take less than ten


class LocalCluster:
    """A router, a spy and one node process for each cell of a topology; a context manager.

    A process that dies is replaced. When the calling process ends, however it ends, all of them do. A job may ask for
    any topology of at most as many cells. Jobs run at the same time while there are enough free nodes; the others wait
    in the order of submission::

        with supernode.LocalCluster(torus=(4, 4)) as cluster:
            result = cluster.submit(supernode.load("examples/arm-ik.toml"), seed=1).result()

    Args:
        torus: rows and columns of a torus, as a pair or as text such as ``"4x4"``.
        topology: another topology instead of ``torus``, as text such as ``"ring 16"``.
        kinds: the built-in kinds of problem that jobs may have; the processes load the kernels of no others. By
            default, all kinds.
        force: start it even if this machine cannot hold so many nodes.
        on_node_death: "replace" to have another process take the place of one that dies once the cluster is ready, so
            that jobs go on; "fail" to fail the cluster and its jobs.
        node_timeout: after how many seconds a process that is stopped (SIGSTOP, say) counts as dead.
        eval_timeout: how many seconds a user's own code may take for each individual that it evaluates at once; None
            for any time. An individual that kills two processes of a node, by taking longer, by a crash or by
            ``node_memory``, counts as infeasible.
        node_memory: how many bytes a node may take for a user's own code; None for any number.

    Raises:
        ValueError: if there is no such topology; the message begins with ``torus`` if that is wrong.
        BadInput: if this machine cannot hold so many nodes.
        ClusterFailed: if kernels must be compiled first and cannot be, or a process dies before all are ready, or they
            are not ready in time.

    Attributes:
        topology: the topology of the nodes.
        seconds_to_ready: how long the start took.
    """

    def __init__(
        self,
        torus: tuple[int, int] | str = (4, 4),
        *,
        topology: str | None = None,
        kinds: Collection[str] | None = None,
        force: bool = False,
        on_node_death: Literal["replace", "fail"] = "replace",
        node_timeout: float = NODE_TIMEOUT,
        eval_timeout: float | None = None,
        node_memory: int | None = None,
    ) -> None:
        if on_node_death not in ("replace", "fail"):
            raise ValueError(f"on_node_death: expected replace or fail, found {on_node_death!r}")
        self.topology = topologies.parse(topology or with_topology({"torus": torus})["topology"])
        capacity.check(self.topology.cells, force=force)  # before anything is compiled
        compile_missing(kinds)  # here, since the zygote would compile on one core
        called = time.monotonic()
        self._kinds = kinds
        self.keys = Keys(secrets.token_hex(4))  # a random name, so that clusters side by side do not meet
        self._failure: str | None = None  # why the cluster cannot be used any more; the first reason stays
        self._changed = threading.Condition()  # guards what the launcher's and Zenoh's threads change too
        self._submitted = 0
        self._closed = False
        self._dispatcher: Dispatcher | None = None
        replaces = on_node_death == "replace"
        self._launcher = Launcher(
            self.keys.cluster,
            self.topology.spec,
            self._on_death,
            kinds=kinds,
            force=force,
            on_replacement=self._on_replacement if replaces else None,
            node_timeout=node_timeout,
            eval_timeout=eval_timeout,
            node_memory=node_memory,
        )
        self._session: zenoh.Session | None = None
        try:
            session = self._connect()
        except BaseException:
            self._disconnect()
            self._launcher.close()
            raise
        self.seconds_to_ready = time.monotonic() - called
        dispatcher = Dispatcher(
            session,
            self.keys,
            Seal(self._launcher.secret),
            self.topology.spec,
            cpu_seconds=self.cpu_seconds_by_process,
            seconds_to_ready=self.seconds_to_ready,
            replaces=replaces,
            eval_timeout=eval_timeout or EVAL_TIMEOUT,
        )
        if replaces:
            self._roster = Roster(session, self.keys, dispatcher.replaced, returned=dispatcher.returned)
            self._roster.look()  # from now on it sees that a process is another one
        with self._changed:
            self._dispatcher = dispatcher
        self._pass_on_failure()  # a process may have died before there was a dispatcher

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def processes(self) -> dict[str, int]:
        """The process ids by name: "router", "spy", "node 0" and so on."""
        return dict(self._launcher.processes)

    def submit(
        self,
        file: ProblemFile | Problem,
        *,
        log: str | None = None,
        least_improvement: float = LEAST,
        checkpoints: str | Path | None = None,
        checkpoint_every: float = CHECKPOINT_EVERY,
        **run: Any,
    ) -> Job:
        """Submit a job; it runs as soon as there are enough free nodes. Its ``seconds`` count from now on.

        Args:
            file: the problem, from `supernode.load` or made in Python.
            log: the path of a run log to write, JSON Lines.
            least_improvement: the least improvement that gets a line there, as a share of the fitness before.
            checkpoints: a folder for checkpoints, from which `resume` goes on; None for no checkpoints.
            checkpoint_every: the seconds from one checkpoint to the next.
            run: settings that replace those of the file's ``[run]`` table, such as ``seed=1``, ``seconds=5``,
                ``torus="2x2"``.

        Raises:
            BadInput: if a setting is unknown or wrong, the log cannot be written, the folder has checkpoints of another
                run, or the cluster was started for other kinds of problem.
            ClusterFailed: if the cluster is closed, or has failed.
        """
        file = file_of(file)
        # Without a topology of its own a job takes the cluster's, whatever the file's settings say.
        asked = any(run.get(name) is not None for name in ("topology", "torus"))
        settings = run if asked else run | {"topology": self.topology.spec}
        asked_for = file.with_run(**settings)
        asked_for.refuse_unreachable()
        spec = JobSpec(0, asked_for, log, least_improvement=least_improvement)
        if checkpoints is not None:
            folder = CheckpointFolder(checkpoints)
            folder.refuse_other_runs()
            spec = replace(spec, checkpoint_every=_positive(checkpoint_every), keep_checkpoint=folder.keep)
        return self._submit(spec)

    def resume(
        self,
        checkpoints: str | Path,
        *,
        log: str | None = None,
        least_improvement: float = LEAST,
        checkpoint_every: float | None = CHECKPOINT_EVERY,
        torus: tuple[int, int] | str | None = None,
        topology: str | None = None,
    ) -> Job:
        """Let a run go on from its latest checkpoint; in lockstep bit for bit, as if it had never ended.

        Args:
            checkpoints: the folder that was given to `submit`; further checkpoints are kept there too.
            log: see `submit`.
            least_improvement: see `submit`.
            checkpoint_every: the seconds from one checkpoint to the next; None for no further ones.
            torus: other rows and columns than before: each cell then begins with the deme of a cell of the checkpoint.
                By default the topology is that of the checkpoint, whatever this cluster's is.
            topology: another topology instead of ``torus``.

        Raises:
            BadInput: if there is no checkpoint that is whole, or the topology is wrong.
            ClusterFailed: if the cluster is closed, or has failed.
        """
        folder = CheckpointFolder(checkpoints)
        checkpoint, _ = folder.latest()
        file = checkpoint.file_on(checkpoint.file.with_run(torus=torus, topology=topology).run.topology)
        spec = JobSpec(
            0,
            file,
            log,
            least_improvement=least_improvement,
            submitted=time.monotonic() - checkpoint.seconds,
            past=checkpoint.past,
            best=checkpoint.best,
            first=checkpoint.first if checkpoint.epoch or checkpoint.states else file,
            checkpoint=checkpoint,
            checkpoint_every=_positive(checkpoint_every),
            keep_checkpoint=folder.keep,
        )
        return self._submit(spec)

    def _submit(self, spec: JobSpec) -> Job:
        """Submit a job under the next number."""
        self._raise_failure()
        self._refuse_other_kinds(spec.file.kind)
        assert self._dispatcher is not None, "ready by now"
        self._submitted += 1
        best = None if spec.best is None else replace(spec.best, job=self._submitted)
        return self._dispatcher.submit(replace(spec, number=self._submitted, best=best))

    def _refuse_other_kinds(self, kind: str) -> None:
        """Refuse a kind whose kernels are not loaded: each node would load them, or compile them, by itself."""
        if self._kinds is not None and registry.is_built_in(kind) and kind not in self._kinds:
            kinds = ", ".join(sorted(self._kinds)) or "users' own kinds only"
            raise BadInput(f"kind: expected {kinds}, for which this cluster was started, found {kind!r}")

    def cpu_seconds(self) -> float:
        """Return the CPU time that all processes have used so far, this one included."""
        return self._launcher.cpu_seconds()

    def cpu_seconds_by_process(self) -> dict[str, float]:
        """Return the CPU time by name: of each of `processes`, of "zygote", and of "coordinator" (this process)."""
        return self._launcher.cpu_seconds_by_process()

    def close(self) -> None:
        """End every process; jobs that still run or wait fail. Idempotent."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._failure = self._failure or "the cluster was closed"
        if self._dispatcher is not None:  # while the processes still run, so that each job ends for this reason
            self._dispatcher.fail(self._failure, closing=True)
            self._dispatcher.wait()
        self._disconnect()
        self._launcher.close()

    def _connect(self) -> zenoh.Session:
        """Wait for the router, then for the liveliness tokens of the spy and of all nodes; return the session.

        A node declares its token once it is linked with all neighbours, so this is the ready barrier.
        """
        self._launcher.started.wait(_READY_WITHIN)
        self._raise_failure()
        endpoint = sessions.unix_socket(self._launcher.folder, "router")
        session = self._session = sessions.client(endpoint)
        awaited = {self.keys.node(cell) for cell in range(self.topology.cells)} | {self.keys.spy}

        def see(sample: zenoh.Sample) -> None:
            with self._changed:
                awaited.discard(str(sample.key_expr))
                self._changed.notify_all()

        watchers = [
            session.liveliness().declare_subscriber(key, direct(see), history=True)
            for key in (self.keys.any_node, self.keys.spy)
        ]
        with self._changed:
            ready = self._changed.wait_for(lambda: not awaited or self._failure, _READY_WITHIN)
        self._raise_failure()
        if not ready:
            raise ClusterFailed(f"not ready within {_READY_WITHIN:.0f} s: {', '.join(sorted(awaited)[:4])}")
        for watcher in watchers:
            watcher.undeclare()  # type: ignore[no-untyped-call]
        return session

    def _disconnect(self) -> None:
        """Close the session before the router ends: it would look for its router for ever otherwise."""
        if self._session is not None:
            self._session.close()  # type: ignore[no-untyped-call]

    def _pass_on_failure(self) -> None:
        if self._failure is not None and self._dispatcher is not None:
            self._dispatcher.fail(self._failure)

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise ClusterFailed(self._failure)

    def _on_replacement(self, text: str) -> None:
        """Fail the cluster if it is not ready yet: others wait for the links of the dead. On the launcher's thread."""
        with self._changed:
            is_ready = self._dispatcher is not None
        if not is_ready:
            self._on_death(text)

    def _on_death(self, text: str | None) -> None:
        """Fail the cluster. Called on the launcher's thread."""
        with self._changed:
            self._failure = self._failure or self._naming_the_cell(text or "")
            self._changed.notify_all()
        self._pass_on_failure()

    def _naming_the_cell(self, text: str) -> str:
        kind, _, rest = text.partition(" ")
        number = rest.split(" ")[0]
        if kind == "node" and number.isdigit():
            return f"{text} (cell {self.topology.place(int(number))})"
        return text


def _positive(checkpoint_every: float | None) -> float | None:
    if checkpoint_every is not None and not checkpoint_every > 0.0:  # so that NaN is refused too
        raise BadInput(f"checkpoint_every: expected more than 0 s, found {checkpoint_every}")
    return checkpoint_every
