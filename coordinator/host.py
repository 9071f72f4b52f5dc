"""A host of nodes that join a cluster: a zygote of its own, in a container or on a machine, which forks so many nodes.

A forked agent asks the coordinator for the nodes' numbers and stays for as long as the host does: its token says that
the host is there, and a coordinator that takes over learns from it which nodes live here. A node that dies is forked
anew under its number. When the host's own process ends, however it ends, all of them do.
"""

import json
import os
import signal
import threading
from collections.abc import Callable
from functools import partial

import zenoh

from coordinator import capacity
from coordinator.errors import ClusterFailed
from coordinator.folders import make_folder, new_folder
from coordinator.zygote import Zygote
from node.node_config import NodeConfig
from problems.modules import Modules
from wire import jobs, sessions
from wire.callbacks import direct
from wire.hosts import Host
from wire.keys import Keys
from wire.seal import Seal
from wire.strict import Rejected

_ENDING = {signal.SIGTERM, signal.SIGINT, signal.SIGHUP}
_JOINED = signal.SIGUSR1
_REFUSED = 101  # the exit status of an agent whose host is not let in
_ANSWER_WITHIN = 5.0  # seconds
_AGAIN = 0.1
_AGENT = "agent"


class HostZygote(Zygote):
    """The forks of one host.

    Args:
        cluster: the name of the cluster.
        router: the endpoint of its router.
        secret: of the cluster; see `wire.seal`.
        modules: users' modules that its nodes may import.
        host: this one, which has no numbers yet.
        force: start its nodes even if this machine cannot hold so many.

    Raises:
        BadInput: if it cannot; says how many it can.
    """

    def __init__(
        self, cluster: str, router: str, secret: bytes, modules: Modules, host: Host, *, force: bool = False
    ) -> None:
        capacity.check(host.wants, force=force, has_router=False)
        folder = new_folder()
        self._lock = make_folder(folder)
        super().__init__(cluster, "", folder, secret, modules)
        self._router = router
        self._host = host
        self.name = f"host {host.name}"
        self._numbers, self._tell_numbers = os.pipe()

    def run(self) -> None:
        """Join, and be there until a signal says that it is to end.

        Raises:
            ClusterFailed: if the cluster does not let it in, or its processes die too often.
        """
        awaited = _ENDING | {signal.SIGCHLD, _JOINED}
        signal.pthread_sigmask(signal.SIG_BLOCK, awaited)
        try:
            self._warm_up(self._host.wants)
            self._fork(_AGENT, self._be_the_agent)
            while (woken := signal.sigwait(awaited)) not in _ENDING:
                if woken == _JOINED:
                    self._fork_nodes()
                elif self._one_died():
                    raise ClusterFailed("this host's processes died too often, or it was not let in; see above")
        finally:
            self._kill_all()

    def _fork_nodes(self) -> None:
        if self._host.nodes:
            return
        self._host = self._host.with_nodes(tuple(json.loads(os.read(self._numbers, 1 << 16))))
        for node in self._host.nodes:
            self._fork_again(f"node {node}")
        numbers = ", ".join(map(str, self._host.nodes))
        self._log("info", f"{len(self._host.nodes)} nodes: {numbers}", self.name)

    def _is_the_end(self, name: str, status: int) -> bool:
        refused = name == _AGENT and os.WIFEXITED(status) and os.WEXITSTATUS(status) == _REFUSED
        return refused or self._dies_too_often()

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
        )

    def _be_the_agent(self) -> None:
        try:
            _as_usual(lambda: attend(self._host, Keys(self.cluster), self._router, Seal(self.secret), self._tell))
        except ClusterFailed as error:
            self._log("error", str(error), self.name)
            os._exit(_REFUSED)

    def _tell(self, nodes: tuple[int, ...]) -> None:
        os.write(self._tell_numbers, json.dumps(nodes).encode())
        os.kill(os.getppid(), _JOINED)


def _as_usual(live: Callable[[], None]) -> None:
    """The life of a child, to which signals mean what they do to any process; Ctrl-C is its parent's business."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _ENDING | {_JOINED})
    live()


def attend(host: Host, keys: Keys, router: str, seal: Seal, tell: Callable[[tuple[int, ...]], None]) -> None:
    """Be the agent of a host until the process is ended; ``tell`` is called with the nodes' numbers.

    Raises:
        ClusterFailed: if the cluster does not let the host in.
    """
    sessions.use_runtime(sessions.NODE_RUNTIME)
    session = sessions.client(router)
    here = [host]

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
    while declared:
        signal.pause()


def _numbers(session: zenoh.Session, keys: Keys, seal: Seal, host: Host) -> tuple[int, ...]:
    """Ask the coordinator until there is one that answers.

    Raises:
        ClusterFailed: if it refuses.
    """
    there = threading.Event()

    def see(sample: zenoh.Sample) -> None:
        (there.set if sample.kind == zenoh.SampleKind.PUT else there.clear)()

    watcher = session.liveliness().declare_subscriber(keys.coordinator, direct(see), history=True)
    while True:
        there.wait()
        request = seal.close(keys.nodes, host.encode())
        for reply in session.get(keys.nodes, payload=request, timeout=_ANSWER_WITHIN):
            if reply.ok is not None:
                watcher.undeclare()  # type: ignore[no-untyped-call]
                return _read(reply.ok.payload.to_bytes())
        threading.Event().wait(_AGAIN)  # it is about to be known, or has just died


def _read(payload: bytes) -> tuple[int, ...]:
    try:
        answer = jobs.decode_answer(payload)
    except Rejected as error:
        raise ClusterFailed(f"the coordinator's answer cannot be read: {error.reason}") from error
    if isinstance(answer, jobs.Refused):
        raise ClusterFailed(answer.message)
    return tuple(int(node) for node in answer.value)
