"""The process around a cell: Zenoh sessions, a mailbox, and the loop that carries out what the cell decides.

It has two sessions. The data session is a peer with direct links to the neighbours only, so an exchange crosses no
router; the control session is a client of the router. The control session's liveliness token says that this node is
alive *and* linked with all its neighbours: counting tokens is the ready barrier.

Zenoh calls back on a thread of its own; callbacks only put mail into a queue, and everything else happens on the main
thread.
"""

import contextlib
import json
import os
import queue
import threading
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import zenoh

import topologies
from node.cell import Action, Answer, Ask, Asked, Cell, Event, Heard, Propose, Publish, Start, Waited
from node.fingerprint import fingerprint
from node.plan import Plan
from problems import BadInput, ProblemFile
from wire import control, sessions
from wire.callbacks import direct, frequent
from wire.control import Begin, Done, Drop, Missed, Prepare, ProposeStop, Refused
from wire.exchange import decode
from wire.keys import Keys
from wire.news import Counters, LogRecord
from wire.report import Report
from wire.strict import Rejected

PATIENCE = 1.0  # seconds without a message, after which a lockstep node asks for it
MOST_REPORTS_PER_SECOND = 256  # of counters, over the whole cluster


@dataclass(frozen=True)
class Berth:
    """A node's place in a cluster.

    Attributes:
        cluster: the cluster's name, part of every key.
        node: the node's number; it lives on the cell of that number.
        topology: who neighbours whom.
        folder: a private folder for Unix sockets.
    """

    cluster: str
    node: int
    topology: str
    folder: Path

    @property
    def keys(self) -> Keys:
        """The cluster's key expressions."""
        return Keys(self.cluster)

    @property
    def router(self) -> str:
        """The endpoint of the cluster's router."""
        return sessions.unix_socket(self.folder, "router")

    def data_endpoint(self, node: int) -> str:
        """Where the data session of a node listens."""
        return sessions.unix_socket(self.folder, f"n{node}")


def live(berth: Berth) -> None:
    """Be a node until the process is ended."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    # More nodes than cores take turns; longer turns mean fewer switches.
    os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
    NodeProcess(berth).run()


@dataclass(frozen=True)
class _News:
    """A neighbour's message, not looked at yet."""

    sender: int
    payload: bytes


@dataclass
class _Assignment:
    """The job that this node is at."""

    cell: Cell
    begun: zenoh.Query | None = None  # to be answered with the report
    rejected: int = 0


class NodeProcess:
    """One node: its links, its mail and its cell."""

    def __init__(self, berth: Berth) -> None:
        self.berth = berth
        self.keys = berth.keys
        topology = topologies.parse(berth.topology)
        slots = topology.neighbours(berth.node)
        self.neighbours = tuple(dict.fromkeys(other for other in slots if other != berth.node))
        self.mail: queue.SimpleQueue[_News | zenoh.Query] = queue.SimpleQueue()
        self.assignment: _Assignment | None = None
        self._complaints: set[tuple[int, str]] = set()
        self._patience_ends = 0.0
        self._stats_due = 0.0
        self._stats_period = max(1.0, topology.cells / MOST_REPORTS_PER_SECOND)
        self._link(slots)
        self._register()

    def _link(self, slots: tuple[int, ...]) -> None:
        """Open the data session and wait until every neighbour can be heard and hears.

        Of two neighbours the one to whom the other is east or south connects. A node declares its token after its
        subscriptions, on the same link: who sees the token may publish to it.
        """
        berth, node = self.berth, self.berth.node
        links = {other for other in slots[1:3] if other != node}
        self.data = sessions.peer(berth.data_endpoint(node), [berth.data_endpoint(other) for other in sorted(links)])
        self.out = self.data.declare_publisher(self.keys.out(node))
        self._subscribers = [
            self.data.declare_subscriber(self.keys.out(other), frequent(self._hearer(other)))
            for other in self.neighbours
        ]
        seen: set[str] = set()
        complete = threading.Event()

        def see(sample: zenoh.Sample) -> None:
            seen.add(str(sample.key_expr))
            if len(seen) == len(self.neighbours):
                complete.set()

        liveliness = self.data.liveliness()
        watchers = [
            liveliness.declare_subscriber(self.keys.node(other), direct(see), history=True) for other in self.neighbours
        ]
        self._data_token = liveliness.declare_token(self.keys.node(node))
        if self.neighbours:
            complete.wait()
        for watcher in watchers:
            watcher.undeclare()  # type: ignore[no-untyped-call]

    def _hearer(self, sender: int) -> Any:
        def hear(sample: zenoh.Sample) -> None:
            self.mail.put(_News(sender, sample.payload.to_bytes()))

        return hear

    def _register(self) -> None:
        """Open the control session; the token comes last, since it means ready."""
        node = self.berth.node
        self.control = sessions.client(self.berth.router)
        self.stats = self.control.declare_publisher(self.keys.stats(node))
        self._queryable = self.control.declare_queryable(self.keys.control(node), direct(self.mail.put))
        self._token = self.control.liveliness().declare_token(self.keys.node(node))

    def run(self) -> None:
        """Handle mail for ever; the coordinator ends the process."""
        while True:
            events = self._collect()
            assignment = self.assignment
            if assignment is None:
                continue
            for action in assignment.cell.step(events):
                self._carry_out(assignment, action)
            self._tell_counters(assignment)

    def _collect(self) -> list[Event]:
        """Wait for mail unless the cell can go on without, and turn all there is into events."""
        events: list[Event] = []
        cell = self.assignment.cell if self.assignment else None
        waiting = cell is not None and cell.state == "running" and not cell.ready
        if waiting or cell is None or cell.state != "running":
            with contextlib.suppress(queue.Empty):
                left = max(0.0, self._patience_ends - time.monotonic()) if waiting else None
                self._open(self.mail.get(timeout=left), events)
        # What is here now, but not what comes meanwhile: neighbours could keep this node reading for ever.
        for _ in range(self.mail.qsize()):
            self._open(self.mail.get_nowait(), events)
        # Mail alone does not restart the clock, only progress: neighbours' own questions must not drown this one's.
        if waiting and time.monotonic() >= self._patience_ends:
            self._patience_ends = time.monotonic() + PATIENCE
            events.append(Waited())
        return events

    def _open(self, mail: _News | zenoh.Query, events: list[Event]) -> None:
        if isinstance(mail, _News):
            self._open_news(mail, events)
        else:
            self._open_command(mail, events)

    def _open_news(self, news: _News, events: list[Event]) -> None:
        assignment = self.assignment
        if assignment is None:
            return
        try:
            events.append(Heard(news.sender, decode(news.payload, assignment.cell.plan.limits)))
        except Rejected as error:
            assignment.rejected += 1
            self._complain(news.sender, error.reason)

    def _complain(self, sender: int, reason: str) -> None:
        """Say once for each sender and reason that its messages are bad; they are counted anyway."""
        if (sender, reason) not in self._complaints:
            self._complaints.add((sender, reason))
            text = f"node {self.berth.node} rejects messages of node {sender}: {reason}"
            self.control.put(self.keys.log, LogRecord("warning", self.berth.node, text).encode())

    def _open_command(self, query: zenoh.Query, events: list[Event]) -> None:
        payload = query.payload.to_bytes() if query.payload is not None else b""
        try:
            command = control.decode(payload)
        except Rejected as error:
            _answer(query, Refused(f"node {self.berth.node}: bad command: {error.reason}"))
            return
        if isinstance(command, Prepare):
            _answer(query, self._prepare(command))
        elif self.assignment is None or command.job != self.assignment.cell.job:
            _answer(query, Refused(f"node {self.berth.node} is not at job {command.job}"))
        elif isinstance(command, Begin):
            self.assignment.begun = query
            events.append(Start())
        elif isinstance(command, ProposeStop):
            events.append(Propose(command.reason))
            _answer(query, Done())
        elif isinstance(command, Missed):
            events.append(Asked(command.generation, query))
        elif isinstance(command, Drop):
            self.assignment = None
            events.clear()
            _answer(query, Done())
        else:
            _answer(query, Refused("that is a command for the spy"))

    def _prepare(self, command: Prepare) -> Done | Refused:
        self.assignment = None
        try:
            plan = Plan.of(ProblemFile.from_json(command.file))
            cell = Cell(plan, self.berth.node, command.job)
        except BadInput as error:
            return Refused(str(error), "input")
        except Exception as error:
            return Refused(f"node {self.berth.node}: {type(error).__name__}: {error}")
        self.assignment = _Assignment(cell)
        return Done(json.dumps(fingerprint()))

    def _carry_out(self, assignment: _Assignment, action: Action) -> None:
        if isinstance(action, Publish):
            self._patience_ends = time.monotonic() + PATIENCE
            self.out.put(action.message.encode())
        elif isinstance(action, Ask):
            self._ask(action, assignment.cell.job)
        elif isinstance(action, Answer):
            assert isinstance(action.question, zenoh.Query)
            with action.question as query:
                query.reply(query.key_expr, action.message.encode())
        elif isinstance(action, Report):
            self._report(assignment, replace(action, rejected=assignment.rejected))

    def _ask(self, action: Ask, job: int) -> None:
        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                self.mail.put(_News(action.neighbour, reply.ok.payload.to_bytes()))

        self.control.get(
            self.keys.control(action.neighbour),
            direct(hear),
            payload=control.encode(Missed(job, action.generation)),
            timeout=PATIENCE,
        )

    def _report(self, assignment: _Assignment, report: Report) -> None:
        if assignment.begun is not None:
            with assignment.begun as query:
                query.reply(query.key_expr, report.encode())
            assignment.begun = None

    def _tell_counters(self, assignment: _Assignment) -> None:
        now = time.monotonic()
        if now < self._stats_due or assignment.cell.state == "prepared":
            return
        self._stats_due = now + self._stats_period
        cell = assignment.cell
        counters = Counters(
            self.berth.node,
            cell.job,
            cell.rows.generation,
            cell.rows.evaluations,
            cell.sent,
            cell.received,
            cell.lost,
            assignment.rejected,
        )
        self.stats.put(counters.encode())


def _answer(query: zenoh.Query, answer: Done | Refused) -> None:
    with query:
        query.reply(query.key_expr, control.encode_answer(answer))
