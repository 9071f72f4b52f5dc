"""The process of the spy: linked to the root cell like a fifth neighbour, as in figure 7 of Ahuactzin et al. 1992.

The spy receives what the root publishes, evaluates and checks each new champion itself, and publishes it as an
improvement of its epoch. The root publishes thousands of messages a second, most of them with the same champion as
before. The network thread therefore decodes them, and queues only new champions for the main thread. Several jobs may
run at once, each with a root of its own.

The control session also collects the nodes' counters, up to 256 a second. Twice a second the spy publishes those that
have come, together, and their sums: a receiver would otherwise wake up for each of them.

The network thread writes `_Root`, `_Assignment.latest`, `SpyProcess._counted` and `SpyProcess.alive`, and appends to
the queue. The main thread does everything else.
"""

import contextlib
import json
import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import zenoh

import topologies
from lowlevel import thread_state
from node.node_config import NodeConfig
from node.plan import Plan
from problems import BadInput
from spy.collector import Collector
from spy.tally import statistics_of
from spy.verification import verify
from topologies import ROOT
from wire import control, sessions
from wire.callbacks import direct, frequent
from wire.champion import Champion
from wire.control import Answer, Begin, Done, Drop, Finish, Judged, Prepare, Refused, Wiring
from wire.exchange import Messages
from wire.news import Counters, Improvement
from wire.seal import Seal
from wire.strict import Rejected

STATISTICS_PERIOD = 0.5  # s between two statistics

# Seconds to wait for the link to the root. The root is there before the spy looks for it, unless it has just died; then
# the spy must not wait long, because other jobs wait for the spy.
_LINKED_WITHIN = 5.0


def watch(config: NodeConfig) -> None:
    """Run the spy in this process; does not return. ``config.node`` is the root's number."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    thread_state.keep_in_this_process()
    SpyProcess(config).run()


class _Root:
    """Decodes the root's messages in one epoch of a job.

    Attributes:
        generation: the root's latest generation.
        rejected: the number of malformed messages.
    """

    def __init__(self, plan: Plan, job: int) -> None:
        self.generation = 0
        self.rejected = 0
        self._job = job
        self._epoch = plan.epoch
        self._limits = plan.limits
        self._message = Messages.room(1, plan.limits.genome_bytes, plan.limits.emigrants)
        self._latest_birth: tuple[int, int] | None = None  # generation and cell of birth of the latest champion

    def hear(self, payload: bytes) -> Champion | None:
        """Return the message's champion if it is another than the last one, else None."""
        message = self._message
        if message.decode(0, payload, self._limits) is not None:
            self.rejected += 1
            return None
        job, epoch, generation, *_, born, birthplace = message.header[0].tolist()
        if (job, epoch) != (self._job, self._epoch):
            return None
        self.generation = generation
        if self._latest_birth == (born, birthplace):
            return None
        self._latest_birth = (born, birthplace)
        return message.champion(0)


@dataclass(eq=False)
class _Assignment:
    """An epoch of a job that the spy watches; in the queue it means that the root has a new champion.

    The main thread takes only the ``latest`` champion, since a better one may be found while it checks another.

    Attributes:
        job: the job's number.
        plan: the epoch's plan.
        problem: the digest of the problem file.
        wiring: the node on each cell.
        collector: keeps the best verified champion.
        root: decodes the root's messages.
        latest: the root's latest champion.
        began: when the epoch began, on the monotonic clock; None before.
        counters: the latest counters of each node.
        heard: when these came, on the monotonic clock.
        rates: messages a second of each node, between its latest two counters.
    """

    job: int
    plan: Plan
    problem: str
    wiring: Wiring
    collector: Collector
    root: _Root
    latest: Champion | None = None
    began: float | None = None
    counters: dict[int, Counters] = field(default_factory=dict)
    heard: dict[int, float] = field(default_factory=dict)
    rates: dict[int, float] = field(default_factory=dict)

    def hear(self, counters: Counters, now: float) -> None:
        """Take a node's counters, which arrived at ``now``."""
        node, before = counters.node, self.counters.get(counters.node)
        if before is not None and now > self.heard[node]:
            self.rates[node] = max(0, counters.sent - before.sent) / (now - self.heard[node])
        self.counters[node], self.heard[node] = counters, now

    @property
    def seconds(self) -> float:
        """Seconds since the epoch began."""
        return 0.0 if self.began is None else time.monotonic() - self.began


class _Link:
    """The link to the root of a job, by a session of its own or through the router.

    Attributes:
        wiring: the wiring that the link belongs to.
        listening: the epochs whose messages are decoded. The network thread iterates over this list, so the main thread
            replaces it as a whole instead of changing it.
    """

    def __init__(
        self, config: NodeConfig, wiring: Wiring, queue: "queue.SimpleQueue[Any]", routed: zenoh.Session
    ) -> None:
        root = wiring.nodes[ROOT]
        self.wiring = wiring
        self.listening: list[_Assignment] = []
        self._queue = queue
        # A spy of a cluster of several hosts may not reach the root directly; the root then publishes through the
        # router too.
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
        """Decode a message of the root, on the network thread; each epoch ignores messages of others."""
        payload = sample.payload.to_bytes()
        for assignment in self.listening:
            champion = assignment.root.hear(payload)
            if champion is not None:
                assignment.latest = champion
                self._queue.put(assignment)

    def close(self) -> None:
        """Stop receiving."""
        self._root.undeclare()  # type: ignore[no-untyped-call]
        if self._own is not None:
            self._own.close()  # type: ignore[no-untyped-call]


class SpyProcess:
    """The spy: takes commands and messages, publishes verified improvements, counters and statistics.

    Attributes:
        queue: work for the main thread: an epoch whose root has a new champion, a command, or None when counters have
            come after a silence.
        alive: the liveliness tokens of all nodes.
        assignments: the latest epoch of each job, by the job's number.
        links: the links to roots, by the number of the root's node.
    """

    def __init__(self, config: NodeConfig) -> None:
        self.config = config
        self.keys = config.keys
        self.queue: queue.SimpleQueue[_Assignment | zenoh.Query | None] = queue.SimpleQueue()
        self._counted: list[tuple[bytes, float]] = []  # encoded counters with their arrival; the network thread appends
        self.alive: set[str] = set()
        self.assignments: dict[int, _Assignment] = {}
        self.links: dict[int, _Link] = {}
        self._due = 0.0  # when the next statistics are due, on the monotonic clock
        self._seal = Seal(config.secret)
        self.control = sessions.client(config.router, config.identity)
        if config.topology:
            nodes = tuple(range(topologies.parse(config.topology).cells))
            self._link(Wiring(0, nodes))
        self._register()

    def _link(self, wiring: Wiring) -> _Link:
        """Return the link to the root of a job: the present one, or a new one if the wiring has changed."""
        root = wiring.nodes[ROOT]
        link = self.links.get(root)
        if link is None or link.wiring.number != wiring.number:
            if link is not None:
                link.close()
            link = self.links[root] = _Link(self.config, wiring, self.queue, self.control)
        return link

    def _register(self) -> None:
        """Declare what the spy receives and answers; its liveliness tokens come last, since they mean "ready"."""
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
        """Keep counters, undecoded; with the first ones wake the main thread, so that it looks at the clock again."""
        self._counted.append((sample.payload.to_bytes(), time.monotonic()))
        if len(self._counted) == 1:
            self.queue.put(None)

    def _see(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.alive.add(str(sample.key_expr))
        else:
            self.alive.discard(str(sample.key_expr))

    def run(self) -> None:
        """Handle the queue and publish statistics forever; the coordinator ends the process."""
        while True:
            left = max(0.0, self._due - time.monotonic())
            with contextlib.suppress(queue.Empty):
                self._open(self.queue.get(timeout=left if self._counted or self._watched() else None))
            now = time.monotonic()
            if now >= self._due:
                self._due = now + STATISTICS_PERIOD
                self._pass_on_counters()
                for assignment in self._watched():
                    self._publish_statistics(assignment)

    def _watched(self) -> list[_Assignment]:
        """Return the epochs that have begun and of which there are counters."""
        return [each for each in self.assignments.values() if each.began is not None and each.counters]

    def _pass_on_counters(self) -> None:
        """Decode the counters that have come meanwhile, and publish the latest of each node in few messages."""
        came = self._counted[:]
        del self._counted[: len(came)]  # only what was copied: the network thread may have appended more
        latest: dict[int, Counters] = {}
        for payload, at in came:
            with contextlib.suppress(Rejected):  # malformed, so from no node of this cluster
                counters = Counters.decode(payload)
                latest[counters.node] = counters
                watched = self.assignments.get(counters.job)
                if watched is not None and watched.plan.epoch == counters.epoch:
                    watched.hear(counters, at)
        for message in Counters.encode_all(latest.values()):
            self.control.put(self.keys.spy_counters, message)

    def _open(self, queued: _Assignment | zenoh.Query | None) -> None:
        if queued is None:
            # Counters have come after a silence. Other nodes' are on their way: wait, to pass them on together.
            self._due = max(self._due, time.monotonic() + STATISTICS_PERIOD / 2)
        elif isinstance(queued, zenoh.Query):
            self._open_command(queued)
        elif self.assignments.get(queued.job) is queued:  # otherwise the epoch is over by now
            self._hear(queued, queued.latest)

    def _hear(self, assignment: _Assignment, champion: Champion | None) -> None:
        better = assignment.collector.hear(champion, assignment.seconds)
        if better is not None:
            self._publish(better)

    def _publish(self, better: Improvement) -> None:
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
        match command:
            case Prepare():
                return self._prepare(command)
            case Drop(job):
                return Done(json.dumps(self._forget(job)))
            case Begin() | Finish():
                return self._obey_in_an_epoch(command)
        return Refused("that is a command for nodes")

    def _obey_in_an_epoch(self, command: Begin | Finish) -> Answer:
        assignment = self.assignments.get(command.job)
        if assignment is None or command.epoch != assignment.plan.epoch:
            return Refused(f"the spy is not at job {command.job}, epoch {command.epoch}", "stranger")
        if isinstance(command, Finish):
            return self._finish(assignment, command)
        self._listen_to(assignment)
        assignment.began = time.monotonic()
        plan, best = assignment.plan, assignment.collector.best
        if best is not None and best.epoch == plan.epoch:  # an answer in this epoch too
            self._publish(best)
        return Done()

    def _prepare(self, command: Prepare) -> Done | Refused:
        """Get ready to watch an epoch of a job; stop watching the epoch before, if there was one."""
        before = self.assignments.get(command.job)
        try:
            file = self.config.modules.read(command.file)
            plan = Plan.of(file, command.epoch)
            best = _better(command.best, before, file.sha256)
            # With the demes the individual behind the answer moves along; a restart draws new ones.
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
        """Listen to the root in this epoch; only once all nodes are prepared, since the root may have to link anew."""
        link = self._link(assignment.wiring)
        link.listening = [*(each for each in link.listening if each is not assignment), assignment]

    def _stop_listening_to(self, assignment: _Assignment | None) -> None:
        for link in self.links.values():
            link.listening = [each for each in link.listening if each is not assignment]

    def _finish(self, assignment: _Assignment, command: Finish) -> Judged:
        """Judge the epoch, whose cells have stopped; the job may go on with another one."""
        # The root's messages may have skipped the best champion, or be under way still; the reports hold it.
        self._hear(assignment, command.champion)
        collector, reasons = assignment.collector, command.reasons
        self._pass_on_counters()
        if assignment.counters:  # a job of less than a second may have no other statistics than these
            # The root has sent no counters of its last generation.
            assignment.root.generation = max(assignment.root.generation, command.generation)
            self._publish_statistics(assignment)
        assignment.rates.clear()  # no cell sends any more, though the job may be kept alive
        judgement = verify(collector, command.generation, reasons, command.error, dict(command.states), command.since)
        return judgement.answer()

    def _forget(self, job: int) -> str | None:
        """Forget a job; return its best answer, encoded, in hexadecimal digits. Nobody is told a better one later."""
        assignment = self.assignments.pop(job, None)
        if assignment is None:
            return None
        self._stop_listening_to(assignment)
        best = assignment.collector.best
        return None if best is None else best.encode().hex()

    def _publish_statistics(self, assignment: _Assignment) -> None:
        counters, root = list(assignment.counters.values()), assignment.root
        statistics = statistics_of(counters, assignment.job, assignment.plan.epoch, root.generation)._replace(
            rejected=root.rejected + sum(each.rejected for each in counters),
            nodes_alive=len(self.alive),
            messages_per_second=sum(assignment.rates.values(), 0.0),
        )
        self.control.put(self.keys.spy_stats, statistics.encode())


def _better(told: bytes, before: _Assignment | None, problem: str) -> Improvement | None:
    """Return the better of two answers: the coordinator's, encoded in ``told``, and that of the epoch ``before``.

    Args:
        told: an encoded improvement; empty if the coordinator knows of none.
        before: the epoch before; it counts only if its problem was the same.
        problem: the digest of the problem file.
    """
    known = [Improvement.decode(told)] if told else []
    if before is not None and before.problem == problem and before.collector.best is not None:
        known.append(before.collector.best)
    return min(known, key=lambda each: each.fitness, default=None)
