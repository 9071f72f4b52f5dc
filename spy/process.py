"""The process of the spy: linked to the root cell like a fifth neighbour, as in figure 7 of Ahuactzin et al. 1992.

It hears what the root publishes, believes a champion once it has evaluated it, and tells the world. The root publishes
thousands of messages a second, most of them with the same champion as before: they are read on the network thread, and
only a new champion is mail for the main thread. The control session also gathers the nodes' counters and log records,
and adds them up twice a second.
"""

import contextlib
import queue
import threading
import time
from dataclasses import dataclass, field
from typing import Any

import zenoh

from node.berth import Berth
from node.plan import Plan
from problems import BadInput, ProblemFile
from spy.collector import Collector
from spy.judge import judge
from spy.run_log import RunLog
from topologies import ROOT
from wire import control, sessions
from wire.callbacks import direct, frequent
from wire.control import Answer, Begin, Done, Drop, Finish, Judged, Prepare, Refused
from wire.exchange import Champion, Messages
from wire.news import Counters, LogRecord, Statistics
from wire.strict import Rejected

STATISTICS_PERIOD = 0.5  # seconds


def watch(berth: Berth) -> None:
    """Be the spy until the process is ended; ``berth.node`` is the root's number."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    SpyProcess(berth).run()


@dataclass(frozen=True)
class _News:
    """A champion of the root's that it has not told before."""

    job: int
    champion: Champion


class _Root:
    """What the root says in one job."""

    def __init__(self, plan: Plan, job: int) -> None:
        self.generation = 0
        self.rejected = 0
        self._job = job
        self._limits = plan.limits
        self._message = Messages.room(1, plan.limits.genome_bytes, plan.limits.emigrants)
        self._told: tuple[int, int] | None = None  # birth of the latest champion

    def hear(self, payload: bytes) -> Champion | None:
        """Its champion, if it is another than the last one."""
        message = self._message
        if message.decode(0, payload, self._limits) is not None:
            self.rejected += 1
            return None
        job, _, generation, *_, born, birthplace = message.header[0].tolist()
        if job != self._job:
            return None
        self.generation = generation
        if self._told == (born, birthplace):
            return None
        self._told = (born, birthplace)
        return message.champion(0)


@dataclass
class _Assignment:
    """The job that is being watched."""

    job: int
    plan: Plan
    collector: Collector
    log: RunLog
    root: _Root
    began: float | None = None  # on the monotonic clock
    counters: dict[int, Counters] = field(default_factory=dict)  # the latest of each node
    messages: int = 0  # when they were last added up,
    added_up: float = 0.0  # at this time

    @property
    def seconds(self) -> float:
        """Since the job began."""
        return 0.0 if self.began is None else time.monotonic() - self.began


class SpyProcess:
    """Mail in, verified improvements and statistics out."""

    def __init__(self, berth: Berth) -> None:
        self.berth = berth
        self.keys = berth.keys
        self.mail: queue.SimpleQueue[_News | Counters | LogRecord | zenoh.Query] = queue.SimpleQueue()
        self.alive: set[str] = set()
        self.assignment: _Assignment | None = None
        self._due = 0.0
        self._link()
        self._register()

    def _link(self) -> None:
        """Link to the root and wait until it is there."""
        self.data = sessions.peer(None, [self.berth.data_endpoint_of(ROOT)])
        self._root = self.data.declare_subscriber(self.keys.out(ROOT), frequent(self._listen))
        linked = threading.Event()
        watcher = self.data.liveliness().declare_subscriber(
            self.keys.node(ROOT), direct(lambda _: linked.set()), history=True
        )
        linked.wait()
        watcher.undeclare()  # type: ignore[no-untyped-call]

    def _listen(self, sample: zenoh.Sample) -> None:
        """On the network thread."""
        assignment = self.assignment
        if assignment is not None:
            champion = assignment.root.hear(sample.payload.to_bytes())
            if champion is not None:
                self.mail.put(_News(assignment.job, champion))

    def _register(self) -> None:
        self.control = sessions.client(self.berth.router)
        liveliness = self.control.liveliness()
        self._subscribers = [
            self.control.declare_subscriber(self.keys.any_stats, direct(self._reader(Counters))),
            self.control.declare_subscriber(self.keys.log, direct(self._reader(LogRecord))),
            liveliness.declare_subscriber(self.keys.any_node, direct(self._see), history=True),
        ]
        self._queryable = self.control.declare_queryable(self.keys.spy_control, direct(self.mail.put))
        self._token = liveliness.declare_token(self.keys.spy)

    def _reader(self, kind: type[Counters] | type[LogRecord]) -> Any:
        def read(sample: zenoh.Sample) -> None:
            with contextlib.suppress(Rejected):  # not one of ours
                self.mail.put(kind.decode(sample.payload.to_bytes()))

        return read

    def _see(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.alive.add(str(sample.key_expr))
        else:
            self.alive.discard(str(sample.key_expr))

    def run(self) -> None:
        """Handle mail for ever; the coordinator ends the process."""
        while True:
            with contextlib.suppress(queue.Empty):
                self._open(self.mail.get(timeout=STATISTICS_PERIOD if self._watching else None))
            if self._watching and time.monotonic() >= self._due:
                self._tell_statistics()

    @property
    def _watching(self) -> bool:
        return self.assignment is not None and self.assignment.began is not None

    def _open(self, mail: _News | Counters | LogRecord | zenoh.Query) -> None:
        assignment = self.assignment
        if isinstance(mail, zenoh.Query):
            self._open_command(mail)
        elif isinstance(mail, LogRecord):
            if assignment is not None:
                assignment.log.write("log", level=mail.level, node=mail.node, text=mail.text)
        elif assignment is not None and isinstance(mail, Counters):
            if mail.job == assignment.job:
                assignment.counters[mail.node] = mail
        elif assignment is not None and isinstance(mail, _News) and mail.job == assignment.job:
            self._hear(assignment, mail.champion)

    def _hear(self, assignment: _Assignment, champion: Champion | None) -> None:
        better = assignment.collector.hear(champion, assignment.seconds)
        if better is not None:
            self.control.put(self.keys.best, better.encode())
            assignment.log.improvement(assignment.plan.topology, better)

    def _open_command(self, query: zenoh.Query) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        answer: Answer
        try:
            answer = self._obey(control.decode(payload))
        except Rejected as error:
            answer = Refused(f"spy: bad command: {error.reason}")
        with query:
            query.reply(query.key_expr, control.encode_answer(answer))

    def _obey(self, command: control.Command) -> Answer:
        if isinstance(command, Prepare):
            return self._prepare(command)
        assignment = self.assignment
        if assignment is None or command.job != assignment.job:
            return Refused(f"the spy is not at job {command.job}")
        if isinstance(command, Begin):
            assignment.began = assignment.added_up = time.monotonic()
            assignment.log.write("start", job=command.job, run=assignment.plan.run.model_dump())
            return Done()
        if isinstance(command, Finish):
            return self._finish(assignment, command)
        if isinstance(command, Drop):
            assignment.log.close()
            self.assignment = None
            return Done()
        return Refused("that is a command for nodes")

    def _prepare(self, command: Prepare) -> Done | Refused:
        try:
            plan = Plan.of(ProblemFile.from_json(command.file))
            log = RunLog(command.log)
        except BadInput as error:
            return Refused(str(error), "input")
        except Exception as error:
            return Refused(f"spy: {type(error).__name__}: {error}")
        self.assignment = _Assignment(command.job, plan, Collector(plan, command.job), log, _Root(plan, command.job))
        return Done()

    def _finish(self, assignment: _Assignment, command: Finish) -> Judged:
        self._hear(assignment, command.champion)
        judgement = judge(
            assignment.collector, command.generation, command.reasons, command.error, dict(command.states)
        )
        assignment.log.end(judgement, command.generation)
        self.assignment = None
        return judgement.answer()

    def _tell_statistics(self) -> None:
        now = time.monotonic()
        self._due = now + STATISTICS_PERIOD
        assignment = self.assignment
        assert assignment is not None
        counters = list(assignment.counters.values())
        messages = sum(each.sent for each in counters)
        rate = (messages - assignment.messages) / max(now - assignment.added_up, STATISTICS_PERIOD / 2)
        assignment.messages, assignment.added_up = messages, now
        statistics = Statistics(
            assignment.job,
            assignment.root.generation,
            sum(each.evaluations for each in counters),
            messages,
            sum(each.lost for each in counters),
            assignment.root.rejected + sum(each.rejected for each in counters),
            len(self.alive),
            max(0.0, rate),
        )
        self.control.put(self.keys.spy_stats, statistics.encode())
        assignment.log.write("statistics", **statistics._asdict())
