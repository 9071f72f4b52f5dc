"""The process around a cell: its links, its queue of tasks, and the threads that carry out what the cell decides.

Zenoh calls back on a network thread of its own. In lockstep the cell is carried on right there, by the call that brings
the last neighbour's message: a generation then costs no change of threads, which is most of what an exchange would
cost. The main thread does whatever may take long or block: commands, reports, questions, generations that take their
time, and in async mode all of them: breeding goes on while messages come in.
"""

import contextlib
import json
import os
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import zenoh

import topologies
from lowlevel import capabilities, linux
from node import cpu_affinity
from node.assignment import MANY_UNREAD, Assignment, Coming
from node.cell import (
    Action,
    Answer,
    Answered,
    Ask,
    Asked,
    Cell,
    Complain,
    Propose,
    Publish,
    Start,
    Waited,
)
from node.cell import Halt as Halted
from node.fingerprint import fingerprint
from node.links import Hear, Links, Task
from node.node_config import NodeConfig
from node.ordinary_path import OrdinaryPath
from node.plan import Plan
from node.turn_taking import TurnTaking
from problems import BadInput
from topologies import Topology
from wire import control, sessions
from wire.callbacks import direct
from wire.control import Begin, Command, Done, Drop, Halt, Look, Missed, Prepare, ProposeStop, Refused, Wiring
from wire.news import Counters, LogRecord, period_of_reports
from wire.report import Report
from wire.seal import Seal
from wire.strict import Rejected

if TYPE_CHECKING:
    from node.fast_path import FastPath

PATIENCE = 1.0  # seconds without a generation, at least, after which a lockstep node asks for what is missing
_WORTH_TELLING = 8  # generations: by then a node that waits for its turn on a core has bred in two of them
_MOST_UNREAD = 1000  # messages, though some neighbour has sent nothing


def fast_path() -> "FastPath | OrdinaryPath":
    """Make the fast path of a node, or what stands in for it where it must not be used."""
    if not capabilities().c_api:
        return OrdinaryPath()
    from node.fast_path import FastPath

    return FastPath()


_FAST_PATH = fast_path()  # before nodes are forked: to make one in each touches forty pages there


def live(config: NodeConfig) -> None:
    """Be a node until the process is ended."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    cpu_affinity.take_turns()
    NodeProcess(config).run()


class NodeProcess:
    """One node: its links, its queue of tasks and its cell."""

    def __init__(self, config: NodeConfig) -> None:
        self.config = config
        self.keys = config.keys
        self.queue: queue.SimpleQueue[Task] = queue.SimpleQueue()  # for the main thread
        self.past: Assignment | None = None  # the epoch before, which neighbours may still be at
        self.assignment: Assignment | None = None
        self.coming: Coming | None = None
        self._ordered: Prepare | Halt | Drop | None = None  # the latest that is for this node
        self._changed = threading.Condition()  # that, or who is linked
        self._questions_due = 0.0
        self._stats_due = 0.0
        self._cluster_nodes = 1
        self._core: int | None = None  # that this node keeps to,
        self._turns = 0.0  # and how long its turns are there
        self._turn_taking = TurnTaking(config.core_tokens)
        self._fast_path = _FAST_PATH
        self._network_thread = 0  # its number; until it is known, that of whoever asks
        self._seal = Seal(config.secret)
        self.control = sessions.client(config.router)
        self.links: Links | None = None  # those of the latest wiring
        if config.topology:
            topology = topologies.parse(config.topology)
            self.links = self._linked(topology, Wiring(0, tuple(range(topology.cells))))
        self._register()

    def _linked(self, topology: Topology, wiring: Wiring, order: Prepare | None = None) -> Links:
        """The links that a job wants: those that there are, or new ones, unless another order comes meanwhile."""
        if self.links is not None and self.links.leads_to(topology, wiring):
            return self.links

        def given_up() -> bool:
            return order is not None and self._ordered is not order

        return Links(
            self.config, topology, wiring, self.control, self.make_handler, self.queue.put, self._changed, given_up
        )

    def _register(self) -> None:
        """The token comes last, since it means ready."""
        node, session = self.config.node, self.control
        self.stats = session.declare_publisher(self.keys.stats(node))
        self._queryable = session.declare_queryable(self.keys.control(node), direct(self._take_command))
        liveliness = session.liveliness()
        self._tokens = [
            liveliness.declare_token(key) for key in (self.keys.life(node, self.config.process), self.keys.node(node))
        ]

    # On the network thread --------------------------------------------------------------------------------------------
    def _take_command(self, query: zenoh.Query) -> None:
        self._network_thread = threading.get_native_id()
        command: Command | Rejected
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            command = control.decode(self._seal.open(str(query.key_expr), payload))
        except Rejected as error:
            command = error
        if (isinstance(command, Prepare) and self.config.node in command.wiring.nodes) or (
            isinstance(command, Drop | Halt) and self._ordered is not None and command.job == self._ordered.job
        ):
            with self._changed:
                self._ordered = command
                self._changed.notify_all()
        self.queue.put(partial(self._open_command, query, command))

    def make_handler(self, sender: int) -> Hear:
        """Return what takes the messages of the cell ``sender``."""
        return self._fast_path.make_handler(sender, partial(self._hear, sender))

    def _hear(self, sender: int, sample: zenoh.Sample) -> None:
        """The ordinary way of a message."""
        payload = sample.payload.to_bytes()
        if (coming := self.coming) is not None:  # each cell takes what is meant for its epoch
            coming.hear(sender, payload)
        assignment = self.assignment
        if assignment is None or not assignment.hears:
            return
        news = assignment.news
        news.append((sender, payload))
        if not assignment.in_lockstep:
            if len(news) >= MANY_UNREAD:
                self._take_in(assignment)
            return
        if self._fast_path.close(assignment):  # only now: who opens it looks at the news afterwards
            assignment.await_messages()
        awaited = assignment.awaited  # only now: whoever replaces it looks at the news afterwards
        awaited.discard(sender)
        if not awaited or len(news) > _MOST_UNREAD:  # else it could only wait for more
            if assignment.inline:
                self._carry_on_briskly(assignment)
            else:
                self.queue.put(_nothing)  # wakes the main thread

    def _take_in(self, assignment: Assignment) -> None:
        """In async mode read what has come, unless the main thread is at it: that one does so in its next step."""
        if assignment.turn.acquire(False):
            try:
                for action in assignment.take_in():
                    self.queue.put(partial(self._carry_out, assignment, action))
            except Exception as error:
                self.queue.put(partial(_fail, error))
            finally:
                assignment.turn.release()

    def _carry_on_briskly(self, assignment: Assignment) -> None:
        """Go on for as long as the cell can, unless the main thread is at it: that one looks again after its turn.

        Nothing here may block, so all but small messages to the neighbours and counters is left to the main thread.
        """
        while assignment.turn.acquire(False):
            self._step_briskly(assignment, assignment.step)
            if not assignment.inline:
                self.queue.put(_nothing)
                return
            if not assignment.busy:
                return

    def _go_on(self, assignment: Assignment) -> None:
        """Do what the fast path left, which has taken the turn."""
        self._step_briskly(assignment, assignment.went_on)
        if assignment.busy:
            self._carry_on_briskly(assignment)

    def _step_briskly(self, assignment: Assignment, step: Callable[[], list[Action]]) -> None:
        """A step within the turn, which ends with it."""
        try:
            self._fast_path.close(assignment)
            for action in step():
                if type(action) is Publish:
                    assignment.links.publish(action)
                else:
                    self.queue.put(partial(self._carry_out, assignment, action))
            if assignment.bred_at >= self._stats_due:
                self._tell_counters(assignment)
            self._keep_to(assignment)
            self._open_fast_path(assignment)
        except Exception as error:
            self.queue.put(partial(_fail, error))
        finally:
            assignment.turn.release()

    def _open_fast_path(self, assignment: Assignment) -> None:
        """If that is possible, until the next step; within the turn."""
        alone = self.coming is None or assignment.in_lockstep  # by whose way messages for other epochs are told apart
        if assignment is not self.assignment or assignment.cell.ended or not alone:
            self._fast_path.close(assignment)
        elif not assignment.in_lockstep:
            self._fast_path.open(assignment, self._take_in)
        else:
            self._fast_path.open(assignment, self._go_on)
            # Only now: what came before it was open goes the ordinary way.
            if assignment.busy and self._fast_path.close(assignment):
                assignment.await_messages()

    def _keep_to(self, assignment: Assignment) -> None:
        """Within its turn: stay where the assignment says, unless the node is at another by now."""
        if assignment is self.assignment:
            self._settle(assignment.core, assignment.turns)

    def _settle(self, core: int | None, seconds: float) -> None:
        """Let both threads stay on a core, or go wherever the kernel likes, and the main one take turns of so long."""
        if seconds != self._turns:
            self._turns = seconds
            linux.ask_for_turns(seconds)
        if core != self._core:
            self._core = core
            with contextlib.suppress(OSError):  # somebody has taken that core away from this process
                for thread in (os.getpid(), self._network_thread):
                    os.sched_setaffinity(thread, cpu_affinity.CORES if core is None else {core})

    # On the main thread -----------------------------------------------------------------------------------------------
    def run(self) -> None:
        """Carry out what is queued and carry the cell on for ever; the coordinator ends the process."""
        while True:
            self._open_mail()
            assignment = self.assignment
            if assignment is None:
                continue
            while assignment.busy:
                self._carry_on(assignment)
                if not self.queue.empty() or assignment.bred_at >= self._stats_due:
                    break
            if assignment.cell.state == "running":
                self._mind_the_time(assignment)

    def _open_mail(self) -> None:
        """Wait for a task unless there is something else to do, and carry out all that are queued."""
        if self.queue.empty():
            with contextlib.suppress(queue.Empty):
                self._attend_to(self.queue.get(timeout=self._idle_seconds()))
        for _ in range(self.queue.qsize()):
            self._attend_to(self.queue.get_nowait())

    def _attend_to(self, task: Task) -> None:
        """It may take long, so that others may breed meanwhile."""
        self._turn_taking.hand_on()
        task()

    def _idle_seconds(self) -> float | None:
        """How long nothing needs to be done unless a task comes; None: for ever."""
        assignment = self.assignment
        if assignment is None or (assignment.cell.state != "running" and not assignment.events):
            return None
        if assignment.busy:
            return 0.0
        return max(0.0, self._main_thread_due(assignment) - time.monotonic())

    def _main_thread_due(self, assignment: Assignment) -> float:
        """When to look at the clock: the network thread tells counters itself for as long as it breeds."""
        return self._stats_due + (PATIENCE if assignment.inline else 0.0)

    def _carry_on(self, assignment: Assignment) -> None:
        self._turn_taking.take_over(assignment)
        with assignment.turn:
            if assignment.in_lockstep:
                self._fast_path.close(assignment)
            if self._may_end_turn(assignment) and self._fast_path.end_turn(self._turn_taking.over_at):
                actions = assignment.went_on()
            else:
                actions = assignment.step()
            for action in actions:
                if type(action) is Publish:
                    self._turn_taking.publish(assignment, action)
                else:
                    self._carry_out(assignment, action)
            self._keep_to(assignment)
            self._open_fast_path(assignment)
        self._turn_taking.step_is_done(assignment)
        if not assignment.in_lockstep and assignment.turns != cpu_affinity.LONG:
            # For the network thread and the neighbours, should they want this core (or Python): else a node breeds
            # hundreds of generations with the same immigrants until its turn is over.
            cpu_affinity.stand_back()

    def _may_end_turn(self, assignment: Assignment) -> bool:
        """Whether there is nothing to do in this turn but to breed, each generation telling something."""
        return (
            self._turn_taking.has_turn
            and self._fast_path.is_open(assignment)
            and assignment.cell.plan.run.interval == 1
            and not assignment.events
            and not assignment.is_to_be_measured
        )

    def _mind_the_time(self, assignment: Assignment) -> None:
        """Now and then, as rarely as counters are told, since a cold look costs as much as some generations."""
        now = time.monotonic()
        if now < self._main_thread_due(assignment):
            return
        self._tell_counters(assignment)
        if assignment.in_lockstep and now >= self._questions_due:
            self._ask_if_it_waits(assignment, now)

    def _ask_if_it_waits(self, assignment: Assignment, now: float) -> None:
        """Ask for what a lockstep cell misses when it waits far longer than usual; less and less often."""
        assignment.look_at_the_clock()
        waited, patience = now - assignment.bred_at, max(PATIENCE, 4 * assignment.gap)
        if waited >= patience:
            assignment.events.append(Waited())
        self._questions_due = now + max(patience - waited, waited, PATIENCE / 2)

    def _open_command(self, query: zenoh.Query, command: Command | Rejected) -> None:
        if isinstance(command, Rejected):
            _answer(query, Refused(f"node {self.config.node}: bad command: {command.reason}"))
        elif isinstance(command, Prepare):
            if self.config.node in command.wiring.nodes:
                _answer(query, self._prepare(command))
            else:
                self._leave(query)
        elif isinstance(command, Drop):
            self._forget(command.job)
            _answer(query, Done())
        elif isinstance(command, Begin):
            self._begin(command, query)
        elif isinstance(command, Look):
            self._show_up(command, query)
        else:
            for assignment in (self.assignment, self.past):
                if assignment is not None and (assignment.job, assignment.epoch) == (command.job, command.epoch):
                    return self._obey(assignment, command, query)
            self._leave(query)
        return None

    def _show_up(self, command: Look, query: zenoh.Query) -> None:
        if self.assignment is not None and self.assignment.job == command.job:
            _answer(query, Done(json.dumps({"cell": self.assignment.cell.cell, "versions": fingerprint()})))
        else:
            self._leave(query)

    def _leave(self, query: zenoh.Query) -> None:
        """What is said to others needs no answer."""
        query.drop()  # type: ignore[no-untyped-call]

    def _obey(self, assignment: Assignment, command: Command, query: zenoh.Query) -> None:
        """A command that is meant for the epoch that this node is at."""
        if isinstance(command, ProposeStop):
            assignment.events.append(Propose(command.reason))
            _answer(query, Done())
        elif isinstance(command, Missed):
            assignment.events.append(Asked(command.generation, query))
            if assignment is self.past:
                self._carry_on(assignment)
        elif isinstance(command, Halt):
            assignment.events.append(Halted())
            self._answer_with_report(assignment, query)
        else:
            _answer(query, Refused("that is a command for the spy"))

    def _prepare(self, command: Prepare) -> Done | Refused:
        """A first epoch is ready to begin; a later one comes after the one that this node is at."""
        goes_on = self._has_lived_before(command) and not command.deme
        if not goes_on and self.assignment is not None:
            self._forget(self.assignment.job)
        self.coming = None
        try:
            file = self.config.modules.read(command.file)
            plan = Plan.of(file, command.epoch, command.since or 0, checked=True)
            if goes_on and self.assignment is not None and not command.fresh:  # a user's own is known here only
                file.keep_coding(self.assignment.cell.plan.coding, plan.coding)
            links = self._linked(plan.topology, command.wiring, command)
            cell = None if goes_on or command.deme else Cell(plan, links.cell, command.job)
        except BadInput as error:
            return Refused(str(error), "input")
        except Exception as error:
            return Refused(f"node {self.config.node}: {type(error).__name__}: {error}")
        self._keep(links)
        self._cluster_nodes = command.cluster_nodes
        if cell is None:
            self.coming = Coming(command.job, plan, links, command.since, command.deme, command.fresh)
            if self.assignment is not None and not self.assignment.in_lockstep:
                self._fast_path.close(self.assignment)  # it cannot tell which epoch a message is for
        else:
            self.assignment = Assignment(cell, links)
        return Done(json.dumps(fingerprint()))

    def _has_lived_before(self, command: Prepare) -> bool:
        """In an earlier epoch of that job; told again to prepare for the same one, this node begins from there."""
        assignment = self.assignment
        return assignment is not None and assignment.job == command.job and assignment.epoch < command.epoch

    def _keep(self, links: Links) -> None:
        """From now on these; those before serve an epoch that has not stopped yet, or nobody."""
        before, self.links = self.links, links
        if (
            before is not None
            and before is not links
            and (self.assignment is None or self.assignment.links is not before)
        ):
            before.close()

    def _begin(self, command: Begin, query: zenoh.Query) -> None:
        """Go; asked again (by a coordinator that takes over), answer that one."""
        assignment, coming = self.assignment, self.coming
        if coming is not None and (coming.job, coming.plan.epoch) == (command.job, command.epoch):
            coming.begun = query
            self._turn_to_the_next_epoch()
        elif assignment is not None and (assignment.job, assignment.epoch) == (command.job, command.epoch):
            if assignment.cell.state == "prepared":
                self._start(assignment, Start())
            self._answer_with_report(assignment, query)
        elif self.past is not None and (self.past.job, self.past.epoch) == (command.job, command.epoch):
            self._answer_with_report(self.past, query)  # the one before may have been lost
        else:
            self._leave(query)

    def _start(self, assignment: Assignment, start: Start) -> None:
        assignment.bred_at = time.monotonic()
        assignment.told = (assignment.bred_at, 0, 0)
        self._questions_due = assignment.bred_at + PATIENCE
        assignment.events.append(start)

    def _answer_with_report(self, assignment: Assignment, query: zenoh.Query) -> None:
        """Now, or when the cell stops."""
        if assignment.begun is not None:
            self._leave(assignment.begun)
        assignment.begun = query
        self._report(assignment)

    def _report(self, assignment: Assignment) -> None:
        if assignment.report is not None and assignment.begun is not None:
            with assignment.begun as query:
                query.reply(query.key_expr, assignment.report)
            assignment.begun = None

    def _turn_to_the_next_epoch(self) -> None:
        """Once it may begin and the one before has stopped; the deme of that one goes on living."""
        before, coming = self.assignment, self.coming
        if coming is None or coming.begun is None or (before is not None and not before.cell.ended):
            return
        bred = 0 if before is None else before.cell.plan.since + before.cell.rows.generation
        plan = replace(coming.plan, since=bred if coming.since is None else coming.since)
        if coming.fresh:
            genomes = None
        else:
            genomes = before.cell.rows.genomes[0] if before is not None else plan.deme_of(coming.deme)
        assignment = Assignment(Cell(plan, coming.links.cell, coming.job), coming.links, coming.news)
        self._leave_the_past()  # not before: somebody may still ask how it ended
        self.past, self.assignment, self.coming = before, assignment, None
        assignment.begun = coming.begun
        self._start(assignment, Start(genomes))

    def _leave_the_past(self) -> None:
        past, self.past = self.past, None
        in_use = (self.links, None if self.assignment is None else self.assignment.links)
        if past is not None and past.links not in in_use:
            past.links.close()

    def _forget(self, job: int) -> None:
        """The latest links stay: the next job may want the same."""
        assignment = self.assignment
        if assignment is not None and assignment.job == job:
            with assignment.turn:
                self._fast_path.forget(assignment)
                self.assignment = None
                self._settle(None, 0.0)
            self._leave_the_past()
            if assignment.links is not self.links:
                assignment.links.close()
        if self.coming is not None and self.coming.job == job:
            self.coming = None

    def _carry_out(self, assignment: Assignment, action: Action) -> None:
        if isinstance(action, Ask):
            self._ask(assignment, action)
        elif isinstance(action, Answer):
            assert isinstance(action.question, zenoh.Query)
            with action.question as query:
                query.reply(query.key_expr, action.payload)
        elif isinstance(action, Complain):
            sender = assignment.links.wiring.nodes[action.sender]
            self._log("warning", f"rejects messages of node {sender}: {action.reason}", assignment.cell)
        elif isinstance(action, Report):
            if action.error is not None:
                self._log("error", action.error, assignment.cell)
            else:  # the last counters, before the report; a cell that failed may not have any individuals to tell of
                self._tell_counters(assignment)
            assignment.report = action.encode()
            self._report(assignment)
            self._turn_to_the_next_epoch()

    def _ask(self, assignment: Assignment, action: Ask) -> None:
        def hear(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                assignment.events.append(Answered(action.neighbour, reply.ok.payload.to_bytes()))
                self.queue.put(_nothing)

        key = self.keys.control(assignment.links.wiring.nodes[action.neighbour])
        missed = control.encode(Missed(assignment.job, assignment.epoch, action.generation))
        self.control.get(
            key,
            direct(hear),
            payload=self._seal.close(key, missed),
            timeout=PATIENCE,
        )

    def _log(self, level: str, text: str, cell: Cell) -> None:
        node, generation = self.config.node, cell.plan.since + cell.rows.generation
        record = LogRecord(level, f"node {node}", text, time.time(), node, cell.cell, cell.job, generation)
        self.control.put(self.keys.log, record.encode())

    def _tell_counters(self, assignment: Assignment) -> None:
        cell, (each_exchange, each_generation) = assignment.cell, assignment.seconds_since_told()
        least = _WORTH_TELLING * each_generation if assignment.hands_on else 0.0
        self._stats_due = time.monotonic() + max(period_of_reports(self._cluster_nodes), least)
        counters = Counters(
            self.config.node,
            cell.cell,
            cell.job,
            cell.plan.epoch,
            cell.plan.since + cell.rows.generation,
            cell.rows.evaluations,
            cell.sent,
            cell.inbox.kept,
            cell.lost,
            cell.inbox.refused,
            *cell.rows.vitals(),
            each_exchange,
        )
        self.stats.put(counters.encode())


def _nothing() -> None:
    """A task that only wakes the main thread."""


def _fail(error: Exception) -> None:
    """What went wrong on the network thread ends the process as if it had on the main one."""
    raise error


def _answer(query: zenoh.Query, answer: Done | Refused) -> None:
    with query:
        query.reply(query.key_expr, control.encode_answer(answer))
