"""The process of the spy: linked to the root cell like a fifth neighbour, as in figure 7 of Ahuactzin et al. 1992.

It hears what the root publishes, believes a champion once it has evaluated and checked it, and tells the epoch. The
root publishes thousands of messages a second, most of them with the same champion as before: they are read on the
network thread, and only a new champion is queued for the main thread. Several jobs may run at once, each with a root of
its own. The control session also gathers the nodes' counters. Twice a second it adds up the counters,
and passes them on together: who shows them would have to wake for each of 256 a second otherwise.
"""

import contextlib
import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import zenoh

import topologies
from node.node_config import NodeConfig
from node.plan import Plan
from problems import BadInput
from spy.collector import Collector
from spy.tally import added_up
from spy.verification import verify
from topologies import ROOT
from wire import control, sessions
from wire.callbacks import direct, frequent
from wire.control import Answer, Begin, Done, Drop, Finish, Judged, Prepare, Refused, Wiring
from wire.exchange import Champion, Messages
from wire.news import Counters, Improvement
from wire.seal import Seal
from wire.strict import Rejected

STATISTICS_PERIOD = 0.5  # seconds

_LINKED_WITHIN = 5.0  # seconds; the root is there before it is said to be, unless it has died, when others wait


def watch(config: NodeConfig) -> None:
    """Be the spy until the process is ended; ``config.node`` is the root's number."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    SpyProcess(config).run()


class _Root:
    """What the root says in one epoch of a job."""

    def __init__(self, plan: Plan, job: int) -> None:
        self.generation = 0
        self.rejected = 0
        self._job = job
        self._epoch = plan.epoch
        self._limits = plan.limits
        self._message = Messages.room(1, plan.limits.genome_bytes, plan.limits.emigrants)
        self._told: tuple[int, int] | None = None  # birth of the latest champion

    def hear(self, payload: bytes) -> Champion | None:
        """Its champion, if it is another than the last one."""
        message = self._message
        if message.decode(0, payload, self._limits) is not None:
            self.rejected += 1
            return None
        job, epoch, generation, *_, born, birthplace = message.header[0].tolist()
        if (job, epoch) != (self._job, self._epoch):
            return None
        self.generation = generation
        if self._told == (born, birthplace):
            return None
        self._told = (born, birthplace)
        return message.champion(0)


@dataclass(eq=False)
class _Assignment:
    """An epoch of a job that is being watched; in the queue: the root has told of a new champion.

    Only the ``latest`` is looked at: a check may take longer than it takes to find something better.
    """

    job: int
    plan: Plan
    problem: str  # its digest
    wiring: Wiring
    collector: Collector
    root: _Root
    latest: Champion | None = None
    began: float | None = None  # on the monotonic clock
    counters: dict[int, Counters] = field(default_factory=dict)  # the latest of each node,
    heard: dict[int, float] = field(default_factory=dict)  # when they came,
    rates: dict[int, float] = field(default_factory=dict)  # and messages a second since those before

    def hear(self, counters: Counters, now: float) -> None:
        """A node's counters have come."""
        node, before = counters.node, self.counters.get(counters.node)
        if before is not None and now > self.heard[node]:
            self.rates[node] = max(0, counters.sent - before.sent) / (now - self.heard[node])
        self.counters[node], self.heard[node] = counters, now

    @property
    def seconds(self) -> float:
        """Since the job began."""
        return 0.0 if self.began is None else time.monotonic() - self.began


class _Link:
    """The session that is linked to the root of a job, and what is heard by it."""

    def __init__(
        self, config: NodeConfig, wiring: Wiring, queue: "queue.SimpleQueue[Any]", routed: zenoh.Session
    ) -> None:
        root = wiring.nodes[ROOT]
        self.wiring = wiring
        self.listening: list[_Assignment] = []  # epochs of the job at that root; replaced as a whole
        self._queue = queue
        # A spy that has joined a cluster is nowhere near the root, which then publishes through the router too.
        self._own = None if config.host else sessions.peer([], [config.data_endpoint(root, wiring.number)])
        session = self._own or routed
        self._root = session.declare_subscriber(config.keys.out(root), frequent(self._listen))
        linked = threading.Event()
        watcher = session.liveliness().declare_subscriber(
            config.keys.node(root), direct(lambda _: linked.set()), history=True
        )
        linked.wait(_LINKED_WITHIN)
        watcher.undeclare()  # type: ignore[no-untyped-call]

    def _listen(self, sample: zenoh.Sample) -> None:
        """On the network thread."""
        payload = sample.payload.to_bytes()
        for assignment in self.listening:
            champion = assignment.root.hear(payload)
            if champion is not None:
                assignment.latest = champion
                self._queue.put(assignment)

    def close(self) -> None:
        """Hear nothing any more."""
        self._root.undeclare()  # type: ignore[no-untyped-call]
        if self._own is not None:
            self._own.close()  # type: ignore[no-untyped-call]


class SpyProcess:
    """Mail in, verified improvements and statistics out."""

    def __init__(self, config: NodeConfig) -> None:
        self.config = config
        self.keys = config.keys
        self.queue: queue.SimpleQueue[_Assignment | zenoh.Query | None] = queue.SimpleQueue()
        self._counted: list[tuple[bytes, float]] = []  # counters, with their times; the network thread appends
        self.alive: set[str] = set()
        self.assignments: dict[int, _Assignment] = {}  # by job: its latest epoch
        self.links: dict[int, _Link] = {}  # by root: its node's number
        self._due = 0.0
        self._seal = Seal(config.secret)
        self.control = sessions.client(config.router)
        if config.topology:
            nodes = tuple(range(topologies.parse(config.topology).cells))
            self._link(Wiring(0, nodes))
        self._register()

    def _link(self, wiring: Wiring) -> _Link:
        """To the root of a job: the link that there is, or a new one."""
        root = wiring.nodes[ROOT]
        link = self.links.get(root)
        if link is None or link.wiring.number != wiring.number:
            if link is not None:
                link.close()
            link = self.links[root] = _Link(self.config, wiring, self.queue, self.control)
        return link

    def _register(self) -> None:
        liveliness = self.control.liveliness()
        self._subscribers = [
            self.control.declare_subscriber(self.keys.any_stats, direct(self._count)),
            liveliness.declare_subscriber(self.keys.any_node, direct(self._see), history=True),
        ]
        self._queryable = self.control.declare_queryable(self.keys.spy_control, direct(self.queue.put))
        self._tokens = [
            liveliness.declare_token(key) for key in (self.keys.spy_life(self.config.process), self.keys.spy)
        ]

    def _count(self, sample: zenoh.Sample) -> None:
        """They are not opened at once; the first one is queued, so that somebody looks at the clock."""
        self._counted.append((sample.payload.to_bytes(), time.monotonic()))
        if len(self._counted) == 1:
            self.queue.put(None)

    def _see(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.alive.add(str(sample.key_expr))
        else:
            self.alive.discard(str(sample.key_expr))

    def run(self) -> None:
        """Handle what is queued for ever; the coordinator ends the process."""
        while True:
            left = max(0.0, self._due - time.monotonic())
            with contextlib.suppress(queue.Empty):
                self._open(self.queue.get(timeout=left if self._counted or self._watched() else None))
            now = time.monotonic()
            if now >= self._due:
                self._due = now + STATISTICS_PERIOD
                self._pass_on_counters()
                for assignment in self._watched():
                    self._tell_statistics(assignment)

    def _watched(self) -> list[_Assignment]:
        return [each for each in self.assignments.values() if each.began is not None and each.counters]

    def _pass_on_counters(self) -> None:
        """All that have come meanwhile."""
        came = self._counted[:]
        del self._counted[: len(came)]
        latest: dict[int, Counters] = {}
        for payload, at in came:
            with contextlib.suppress(Rejected):  # not one of ours
                counters = Counters.decode(payload)
                latest[counters.node] = counters
                watched = self.assignments.get(counters.job)
                if watched is not None and watched.plan.epoch == counters.epoch:
                    watched.hear(counters, at)
        for message in Counters.encode_all(latest.values()):
            self.control.put(self.keys.spy_counters, message)

    def _open(self, queued: _Assignment | zenoh.Query | None) -> None:
        if queued is None:  # after a silence: the others' counters are on their way
            self._due = max(self._due, time.monotonic() + STATISTICS_PERIOD / 2)
        elif isinstance(queued, zenoh.Query):
            self._open_command(queued)
        elif self.assignments.get(queued.job) is queued:
            self._hear(queued, queued.latest)

    def _hear(self, assignment: _Assignment, champion: Champion | None) -> None:
        better = assignment.collector.hear(champion, assignment.seconds)
        if better is not None:
            self._tell(better)

    def _tell(self, better: Improvement) -> None:
        self.control.put(self.keys.best, better.encode())

    def _open_command(self, query: zenoh.Query) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        answer: Answer
        try:
            answer = self._obey(control.decode(self._seal.open(str(query.key_expr), payload)))
        except Rejected as error:
            answer = Refused(f"spy: bad command: {error.reason}")
        with query:
            query.reply(query.key_expr, control.encode_answer(answer))

    def _obey(self, command: control.Command) -> Answer:
        if isinstance(command, Prepare):
            return self._prepare(command)
        if isinstance(command, Drop):
            self._forget(command.job)
            return Done()
        if not isinstance(command, Begin | Finish):
            return Refused("that is a command for nodes")
        assignment = self.assignments.get(command.job)
        if assignment is None or command.epoch != assignment.plan.epoch:
            return Refused(f"the spy is not at job {command.job}, epoch {command.epoch}", "stranger")
        if isinstance(command, Finish):
            return self._finish(assignment, command)
        self._listen_to(assignment)
        assignment.began = time.monotonic()
        plan, best = assignment.plan, assignment.collector.best
        if best is not None and best.epoch == plan.epoch:  # an answer in this epoch too
            self._tell(best)
        return Done()

    def _prepare(self, command: Prepare) -> Done | Refused:
        """Watch an epoch of a job, instead of the one before if there was one."""
        before = self.assignments.get(command.job)
        try:
            file = self.config.modules.read(command.file)
            plan = Plan.of(file, command.epoch)
            best = _better(command.best, before, file.sha256)
            if best is not None and not command.fresh:
                best = best.carried_to(command.epoch)
        except BadInput as error:
            return Refused(str(error), "input")
        except Exception as error:
            return Refused(f"spy: {type(error).__name__}: {error}")
        collector, root = Collector(plan, command.job, best), _Root(plan, command.job)
        self.assignments[command.job] = _Assignment(command.job, plan, file.sha256, command.wiring, collector, root)
        self._stop_listening_to(before)
        return Done()

    def _listen_to(self, assignment: _Assignment) -> None:
        """Not before the nodes are prepared: the root may have to link itself anew."""
        link = self._link(assignment.wiring)
        link.listening = [*(each for each in link.listening if each is not assignment), assignment]

    def _stop_listening_to(self, assignment: _Assignment | None) -> None:
        for link in self.links.values():
            link.listening = [each for each in link.listening if each is not assignment]

    def _finish(self, assignment: _Assignment, command: Finish) -> Judged:
        """Judge; the job may go on with another epoch."""
        self._hear(assignment, command.champion)
        collector, reasons = assignment.collector, command.reasons
        self._pass_on_counters()
        if assignment.counters:  # of a job that took no second these may be the only ones
            # The root has sent no counters of its last generation.
            assignment.root.generation = max(assignment.root.generation, command.generation)
            self._tell_statistics(assignment)
        assignment.rates.clear()  # nobody sends any more, though the job may be kept alive
        judgement = verify(collector, command.generation, reasons, command.error, dict(command.states), command.since)
        return judgement.answer()

    def _forget(self, job: int) -> None:
        assignment = self.assignments.pop(job, None)
        if assignment is not None:
            self._stop_listening_to(assignment)

    def _tell_statistics(self, assignment: _Assignment) -> None:
        counters, root = list(assignment.counters.values()), assignment.root
        statistics = added_up(counters, assignment.job, assignment.plan.epoch, root.generation)._replace(
            rejected=root.rejected + sum(each.rejected for each in counters),
            nodes_alive=len(self.alive),
            messages_per_second=sum(assignment.rates.values(), 0.0),
        )
        self.control.put(self.keys.spy_stats, statistics.encode())


def _better(told: bytes, before: _Assignment | None, problem: str) -> Improvement | None:
    """The better answer of what the coordinator has ``told`` and what was known in the epoch ``before``, if any."""
    known = [Improvement.decode(told)] if told else []
    if before is not None and before.problem == problem and before.collector.best is not None:
        known.append(before.collector.best)
    return min(known, key=lambda each: each.fitness, default=None)
