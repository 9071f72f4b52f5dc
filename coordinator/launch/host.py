"""A host of nodes that join a cluster: a zygote of its own, in a container or on another machine.

The host's zygote first forks an agent, since the zygote itself must not open a Zenoh session (a fork after that hangs).
The agent asks the coordinator for the nodes' numbers, writes them to a pipe and signals the zygote, which then forks
the nodes. The agent runs as long as the host does: its liveliness token says that the host is present, and a
coordinator that takes over asks it which nodes run here. A node that dies is replaced under the same number. After
SIGTERM the agent has the jobs moved to other hosts, and then the host ends. When the zygote ends, however it ends, all
its children do.
"""

import contextlib
import json
import os
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import zenoh

from coordinator.errors import ClusterFailed
from coordinator.launch import capacity
from coordinator.launch.folders import make_folder, new_folder
from coordinator.launch.sandbox import HOST_KINDS, Sandbox
from coordinator.launch.stopped import NODE_TIMEOUT
from coordinator.launch.zygote import Zygote
from node.evaluation_limits import EvaluationLimits
from node.node_config import NodeConfig
from problems.modules import Modules
from wire import jobs, sessions
from wire.callbacks import direct
from wire.hosts import Host
from wire.keys import Keys
from wire.members import Identity
from wire.seal import Seal
from wire.strict import Rejected

_ENDING = {signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
_JOINED = signal.SIGUSR1  # from the agent: the nodes' numbers are in the pipe
LEAVE = signal.SIGUSR2  # to the agent: have the jobs moved away, and end
_REFUSED = 101  # exit status of an agent whose host the coordinator has refused
DRAINED = 102  # exit status of an agent whose host no job needs any more
_DRAINED_WITHIN = 25.0  # seconds; Kubernetes and Slurm kill 30 s after SIGTERM
_ANSWER_WITHIN = 5.0  # seconds
_AGAIN = 0.1  # seconds
_NOBODY_FOR = 5.0  # seconds without a coordinator; one that has died is back sooner
_NO_ROOM_AGAIN = 1.0  # seconds
_AGENT = "agent"


class HostZygote(Zygote):
    """Forks the agent and the nodes of one host.

    Args:
        cluster: the name of the cluster.
        router: the endpoint of the cluster's router.
        secret: the cluster's secret; see `wire.seal`.
        modules: users' modules that the nodes may import.
        host: this host, which has no node numbers yet.
        force: start the nodes even if this machine cannot hold so many.
        node_timeout: after how many seconds a process that is stopped counts as dead.
        limits: what an evaluation in a user's own code may take.
        identity: who the host shows itself to be on encrypted links; None if there are none.
        sandbox: whether the nodes have no network; the router's endpoint must then be a Unix socket.

    Raises:
        BadInput: if this machine cannot hold so many nodes; the message says how many it can hold.
    """

    def __init__(
        self,
        cluster: str,
        router: str,
        secret: bytes,
        modules: Modules,
        host: Host,
        *,
        force: bool = False,
        node_timeout: float = NODE_TIMEOUT,
        limits: EvaluationLimits,
        identity: Identity | None = None,
        sandbox: bool = False,
    ) -> None:
        capacity.check(host.wants, force=force, has_router=False)
        folder = new_folder()
        self._lock = make_folder(folder)
        super().__init__(cluster, "", folder, secret, modules, node_timeout=node_timeout, limits=limits)
        self._router = router
        self._identity = identity
        self._is_sandboxed = sandbox
        self._host = host
        self.name = f"host {host.name}"
        self._numbers, self._tell_numbers = os.pipe()
        self._until: float | None = None  # when the host ends even if a job still needs it, once it is about to end
        self._is_drained = False

    def run(self) -> None:
        """Join the cluster and run until SIGTERM, SIGINT or SIGHUP comes; after SIGTERM jobs may move away first.

        Raises:
            ClusterFailed: if the coordinator refuses the host, the system refuses the sandbox, or processes die too
                often.
        """
        self._sandbox = Sandbox(HOST_KINDS if self._is_sandboxed else ())
        awaited = _ENDING | {signal.SIGCHLD, _JOINED}
        signal.pthread_sigmask(signal.SIG_BLOCK, awaited)
        try:
            self._warm_up(self._host.wants)
            self._fork(_AGENT, self._be_the_agent)
            while (woken := self._next_signal(awaited)) is not None:
                if woken == _JOINED:
                    self._fork_nodes()
                elif self._one_died():
                    if self._is_drained:
                        return
                    raise ClusterFailed(
                        "this host's processes died too often, or the cluster refused it; see the log above"
                    )
        finally:
            self._kill_all()

    def _next_signal(self, awaited: set[signal.Signals]) -> int | None:
        """Return the next signal to act on; None if the host is to end.

        SIGTERM has the jobs moved away first, for a limited time; another signal then ends the host at once.
        """
        while True:
            ends_in = None if self._until is None else max(0.0, self._until - time.monotonic())
            lefts = [each for each in (ends_in, self._stopped.seconds_left()) if each is not None]
            found = signal.sigtimedwait(awaited, min(lefts)) if lefts else signal.sigwaitinfo(awaited)
            if found is None:
                return None if ends_in is not None and ends_in <= min(lefts) else signal.SIGCHLD
            if found.si_signo not in _ENDING:
                return found.si_signo
            agent = next((process for process, name in self.children.items() if name == _AGENT), None)
            if found.si_signo != signal.SIGTERM or self._until is not None or agent is None or not self._host.nodes:
                return None
            self._until = time.monotonic() + _DRAINED_WITHIN
            os.kill(agent, LEAVE)

    def _fork_nodes(self) -> None:
        if self._host.nodes:  # forked already
            return
        self._host = self._host.with_nodes(tuple(json.loads(os.read(self._numbers, 1 << 16))))
        for node in self._host.nodes:
            self._fork_again(f"node {node}")
        numbers = ", ".join(map(str, self._host.nodes))
        self._log("info", f"{len(self._host.nodes)} nodes: {numbers}", self.name)

    def _tell_processes(self, died: str | None = None) -> None:
        """Tell nobody: a host has no caller who reads it."""

    def _is_the_end(self, name: str, status: int) -> bool:
        code = os.WEXITSTATUS(status) if name == _AGENT and os.WIFEXITED(status) else None
        self._is_drained = code == DRAINED
        return code in (_REFUSED, DRAINED) or self._deaths.are_too_many(len(self.children))

    def _fork_again(self, name: str) -> None:
        if name == _AGENT:
            self._fork(name, self._be_the_agent)
        else:
            number = int(name.removeprefix("node "))
            self._fork(name, lambda: _as_usual(partial(self._node_live, self._config(number))))

    def _config(self, node: int, topology: str = "") -> NodeConfig:
        return NodeConfig(
            self.cluster,
            node,
            topology,
            self.folder,
            self._router,
            self.secret,
            self.modules,
            self._host.id,
            self._core_tokens,
            self._deaths.crash_of(f"node {node}"),
            self._limits,
            self._identity,
        )

    def _be_the_agent(self) -> None:
        try:
            keys, seal, leaves = Keys(self.cluster), Seal(self.secret), self._until is not None
            _as_usual(lambda: attend(self._host, keys, self._router, self._identity, seal, self._tell, leaves=leaves))
        except ClusterFailed as error:
            self._log("error", str(error), self.name)
            os._exit(_REFUSED)

    def _tell(self, nodes: tuple[int, ...]) -> None:
        os.write(self._tell_numbers, json.dumps(nodes).encode())
        os.kill(os.getppid(), _JOINED)


def _as_usual(live: Callable[[], None]) -> None:
    """Call ``live`` in a child, with the signals unblocked that the zygote blocks; it alone reacts to ending ones."""
    for kind in _ENDING:  # Slurm and systemd send SIGTERM to all processes; these end with the zygote
        signal.signal(kind, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING | {_JOINED})
    live()


def attend(
    host: Host,
    keys: Keys,
    router: str,
    identity: Identity | None,
    seal: Seal,
    tell: Callable[[tuple[int, ...]], None],
    *,
    leaves: bool = False,
) -> None:
    """Run as the agent of a host until the process is killed.

    Args:
        host: the host. If it has node numbers already, the agent before this one has died, and none are asked for.
        keys: the key expressions of the cluster.
        router: the endpoint of the cluster's router.
        identity: who the host shows itself to be on encrypted links.
        seal: seals what the agent sends.
        tell: called once with the nodes' numbers, if they were asked for.
        leaves: whether the host is about to end already.

    Raises:
        ClusterFailed: if the coordinator refuses the host.
    """
    leave = threading.Event()
    if leaves:
        leave.set()
    signal.signal(LEAVE, lambda *_: leave.set())
    sessions.use_runtime(sessions.NODE_RUNTIME)
    session = sessions.client(router, identity)
    here = [host]  # as it is now; Zenoh's thread reads it

    def present(query: zenoh.Query) -> None:
        with query:
            query.reply(keys.host(host.id), seal.close(keys.host(host.id), here[0].encode()))

    declared = [
        session.liveliness().declare_token(keys.host(host.id)),
        session.declare_queryable(keys.host(host.id), direct(present)),
    ]
    if not host.nodes:
        here[0] = host.with_nodes(_numbers(session, keys, seal, host))
        tell(here[0].nodes)
    leave.wait()
    assert declared, "they are there as long as this process waits"
    _drain(session, keys, seal, here[0])
    os._exit(DRAINED)


def _drain(session: zenoh.Session, keys: Keys, seal: Seal, host: Host) -> None:
    """Ask that the jobs be moved away from this host, until no job needs it or nobody has answered for a while."""
    heard = time.monotonic()
    while True:
        needed = None
        request = seal.close(keys.nodes, replace(host, leaving=True).encode())  # anew: a repeated one is refused
        for reply in session.get(keys.nodes, payload=request, timeout=_ANSWER_WITHIN):
            if reply.ok is not None:
                with contextlib.suppress(ClusterFailed):
                    needed = _read(reply.ok.payload.to_bytes())
        if needed is not None:
            heard = time.monotonic()
        if needed == () or time.monotonic() > heard + _NOBODY_FOR:
            return
        threading.Event().wait(_AGAIN)


def _numbers(session: zenoh.Session, keys: Keys, seal: Seal, host: Host) -> tuple[int, ...]:
    """Ask for the nodes' numbers until a coordinator gives some; it gives none while there is no room, or no disk.

    Raises:
        ClusterFailed: if the coordinator refuses the host.
    """
    there = threading.Event()

    def see(sample: zenoh.Sample) -> None:
        (there.set if sample.kind == zenoh.SampleKind.PUT else there.clear)()

    watcher = session.liveliness().declare_subscriber(keys.coordinator, direct(see), history=True)
    while True:
        there.wait()
        pause = _AGAIN  # the coordinator's queryable may not be known yet, or it has just died
        request = seal.close(keys.nodes, host.encode())
        for reply in session.get(keys.nodes, payload=request, timeout=_ANSWER_WITHIN):
            if reply.ok is not None:
                if numbers := _read(reply.ok.payload.to_bytes()):
                    watcher.undeclare()  # type: ignore[no-untyped-call]
                    return numbers
                pause = _NO_ROOM_AGAIN
        threading.Event().wait(pause)


def _read(payload: bytes) -> tuple[int, ...]:
    try:
        answer = jobs.decode_answer(payload)
    except Rejected as error:
        raise ClusterFailed(f"the coordinator's answer cannot be read: {error.reason}") from error
    if isinstance(answer, jobs.Refused):
        raise ClusterFailed(answer.message)
    return tuple(int(node) for node in answer.value)
