"""The process of a node: it connects one cell to its neighbours, and its two threads carry out the cell's actions.

Zenoh invokes callbacks on its own network thread. In lockstep that thread also runs the cell: the callback that
receives the last neighbour's message breeds and publishes. A generation then needs no thread switch, which would be
most of an exchange's cost. The main thread does everything that may take long or block: commands, reports, questions to
neighbours, long generations, and in async mode every generation, so that messages still arrive while it breeds.

Who may touch what:
    - The cell (`Assignment.cell`) belongs to the thread that holds `Assignment.turn`, a lock. The network thread only
      tries to get the lock and never waits for it; when it fails, the holder looks at the news again after its step.
      Two exceptions: counters are read without it, beside breeding; and in async mode, where only the main thread
      breeds, `TurnTaking` takes back the number of an unsent message without it.
    - `Assignment.news` and `Assignment.events` may be appended to without the lock. The network thread appends to the
      news; the thread that holds the lock removes from both.
    - `assignment`, `past`, `coming` and `links` are assigned on the main thread only. The network thread copies one
      into a local variable before it uses it twice.
    - `queue` takes tasks from any thread; only the main thread runs them.
    - The fast path (`node.fast_path`) runs on the network thread, in place of `_hear`; only `FastPath.end_turn` is
      called by the main thread.
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

PATIENCE = 1.0  # s: a lockstep node waits at least this long before it asks a neighbour for a missing message
_GENERATIONS_BETWEEN_COUNTERS = 8  # at least, of a node that waits for its turn on a core: that takes two turns
_MOST_UNREAD = 1000  # messages: a lockstep node reads so many even if a neighbour has sent nothing, to bound memory


def fast_path() -> "FastPath | OrdinaryPath":
    """Make the fast path of a node, or what stands in for it where it must not be used."""
    if not capabilities().c_api:
        return OrdinaryPath()
    from node.fast_path import FastPath

    return FastPath()


# Made when the zygote imports this module, not in each node: making one touches forty pages, which a forked node would
# have to copy. Each node still has its own, because a fork copies what the node writes to.
_FAST_PATH = fast_path()


def live(config: NodeConfig) -> None:
    """Run a node in this process; does not return, since the coordinator or the zygote ends the process."""
    sessions.use_runtime(sessions.NODE_RUNTIME)
    cpu_affinity.take_turns()
    NodeProcess(config).run()


class NodeProcess:
    """One node: its links, its queue of tasks and its cell. See the module for which thread may use what.

    Attributes:
        config: the node's place in the cluster.
        keys: the cluster's key expressions.
        queue: tasks for the main thread.
        assignment: the epoch that this node is in; None while it has no job.
        past: the epoch before, kept because neighbours may still ask for its messages and the coordinator for its end.
        coming: the next epoch, prepared but not begun.
        control: the session through the router.
        links: the links of the latest wiring; None if this node has had none yet.
        stats: publishes the node's counters.
    """

    def __init__(self, config: NodeConfig) -> None:
        self.config = config
        self.keys = config.keys
        self.queue: queue.SimpleQueue[Task] = queue.SimpleQueue()
        self.past: Assignment | None = None
        self.assignment: Assignment | None = None
        self.coming: Coming | None = None
        # The latest command that makes links prepared for an earlier one useless; the network thread writes it while
        # the main thread may be waiting for neighbours in `Links`.
        self._order: Prepare | Halt | Drop | None = None
        self._changed = threading.Condition()  # notified when `_order` changes or a neighbour is linked
        self._questions_due = 0.0  # when to ask for missing messages, on the monotonic clock
        self._stats_due = 0.0  # when to send counters, on the monotonic clock
        self._cluster_nodes = 1
        self._core: int | None = None  # the core that this node is pinned to
        self._turns = 0.0  # s: the time slice that the main thread has asked the kernel for
        self._turn_taking = TurnTaking(config.core_tokens)
        self._fast_path = _FAST_PATH
        self._network_thread = 0  # its thread id; until that is known 0, which the kernel takes for the calling thread
        self._seal = Seal(config.secret)
        self.control = sessions.client(config.router)
        self.links: Links | None = None
        if config.topology:
            topology = topologies.parse(config.topology)
            self.links = self._linked(topology, Wiring(0, tuple(range(topology.cells))))
        self._register()

    def _linked(self, topology: Topology, wiring: Wiring, order: Prepare | None = None) -> Links:
        """Return links for a wiring: the present ones if they fit, else new ones, which may wait for neighbours.

        Raises:
            TimeoutError: if a neighbour cannot be linked, or a newer command than ``order`` arrives while this waits.
        """
        if self.links is not None and self.links.leads_to(topology, wiring):
            return self.links

        def given_up() -> bool:
            return order is not None and self._order is not order

        return Links(
            self.config, topology, wiring, self.control, self.make_handler, self.queue.put, self._changed, given_up
        )

    def _register(self) -> None:
        """Declare what this node publishes and answers; the liveliness tokens come last, since they mean "ready"."""
        node, session = self.config.node, self.control
        self.stats = session.declare_publisher(self.keys.stats(node))
        self._queryable = session.declare_queryable(self.keys.control(node), direct(self._take_command))
        liveliness = session.liveliness()
        self._tokens = [
            liveliness.declare_token(key) for key in (self.keys.life(node, self.config.process), self.keys.node(node))
        ]

    # On the network thread --------------------------------------------------------------------------------------------
    def _take_command(self, query: zenoh.Query) -> None:
        """Decode a command and queue it for the main thread, which carries it out."""
        self._network_thread = threading.get_native_id()  # known before there is a cell, so before anything is pinned
        command: Command | Rejected
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            command = control.decode(self._seal.open(str(query.key_expr), payload))
        except Rejected as error:
            command = error
        if (isinstance(command, Prepare) and self.config.node in command.wiring.nodes) or (
            isinstance(command, Drop | Halt) and self._order is not None and command.job == self._order.job
        ):
            # Noted here already: the main thread may be waiting in `Links` for a neighbour that has died. It would not
            # take the command from its queue before that wait ends, and this ends it.
            with self._changed:
                self._order = command
                self._changed.notify_all()
        self.queue.put(partial(self._open_command, query, command))

    def make_handler(self, sender: int) -> Hear:
        """Return the callback for messages of the cell ``sender``: the fast path while that is open, else `_hear`."""
        return self._fast_path.make_handler(sender, partial(self._hear, sender))

    def _hear(self, sender: int, sample: zenoh.Sample) -> None:
        """Take a message by the ordinary path, that is in Python: keep it, and let the cell step if it may be ready."""
        payload = sample.payload.to_bytes()
        # Both epochs get the message, because its epoch has not been decoded yet: each cell ignores the other's.
        if (coming := self.coming) is not None:
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
        # The order of these lines matters: the main thread may run between any two. Append first, then close: a thread
        # that opens the fast path looks at the news afterwards, so one of the two threads sees the message. Append
        # first, then discard: `await_messages` replaces the set first and reads the news afterwards, so the sender is
        # missing from whichever set counts. A stale set costs a step in vain at most, never a missed one.
        if self._fast_path.close(assignment):
            assignment.await_messages()  # the fast path read messages without keeping `awaited` up to date
        awaited = assignment.awaited
        awaited.discard(sender)
        if not awaited or len(news) > _MOST_UNREAD:  # otherwise a step would find a message missing
            if assignment.inline:
                self._carry_on_inline(assignment)
            else:
                self.queue.put(_nothing)  # wakes the main thread

    def _take_in(self, assignment: Assignment) -> None:
        """In async mode let the cell read its unread messages, to bound memory while the main thread waits for a core.

        If the main thread holds the lock, this does nothing: that thread reads them in its next step.
        """
        if assignment.turn.acquire(False):
            try:
                for action in assignment.take_in():
                    self.queue.put(partial(self._carry_out, assignment, action))
            except Exception as error:
                self.queue.put(partial(_fail, error))
            finally:
                assignment.turn.release()

    def _carry_on_inline(self, assignment: Assignment) -> None:
        """Step the cell on the network thread for as long as it can breed.

        If the main thread holds the lock, this returns: that thread looks for messages again after its step. Nothing
        here may block, so everything except small messages to neighbours and counters is queued for the main thread.
        """
        while assignment.turn.acquire(False):
            self._step_inline(assignment, assignment.step)  # releases the lock
            if not assignment.inline:  # generations have become long: the main thread takes over
                self.queue.put(_nothing)
                return
            if not assignment.busy:  # a neighbour may be one exchange ahead, so the next step may be possible already
                return

    def _finish_fast_path(self, assignment: Assignment) -> None:
        """Finish what the fast path has left to Python; the fast path has acquired the turn lock, this releases it."""
        self._step_inline(assignment, assignment.went_on)
        if assignment.busy:
            self._carry_on_inline(assignment)

    def _step_inline(self, assignment: Assignment, step: Callable[[], list[Action]]) -> None:
        """Take one step on the network thread; the caller has acquired the turn lock, this releases it."""
        try:
            self._fast_path.close(assignment)  # one of the two is at the cell; `_open_fast_path` opens it afresh
            for action in step():
                if type(action) is Publish:
                    assignment.links.publish(action)
                else:
                    self.queue.put(partial(self._carry_out, assignment, action))
            if assignment.bred_at >= self._stats_due:
                self._send_counters(assignment)
            self._keep_to(assignment)
            self._open_fast_path(assignment)
        except Exception as error:  # raised here it would end in Zenoh's callback; the main thread ends the process
            self.queue.put(partial(_fail, error))
        finally:
            assignment.turn.release()

    def _open_fast_path(self, assignment: Assignment) -> None:
        """Open the fast path if the coming messages may take it, else close it; requires the turn lock."""
        # In async mode the fast path does not read messages, so it could not hand one on to the epoch that is coming.
        # In lockstep it does, and leaves a message of another epoch to the ordinary path.
        alone = self.coming is None or assignment.in_lockstep
        if assignment is not self.assignment or assignment.cell.ended or not alone:
            self._fast_path.close(assignment)
        elif not assignment.in_lockstep:
            self._fast_path.open(assignment, self._take_in)
        else:
            self._fast_path.open(assignment, self._finish_fast_path)
            # Look only now: a message that came before the path was open is among the news, where the path never looks.
            # The ordinary path then takes the next messages, and needs `awaited` to be right again.
            if assignment.busy and self._fast_path.close(assignment):
                assignment.await_messages()

    def _keep_to(self, assignment: Assignment) -> None:
        """Apply the assignment's core and time slice; requires the turn lock. A past epoch no longer decides them."""
        if assignment is self.assignment:
            self._pin(assignment.core, assignment.turns)

    def _pin(self, core: int | None, seconds: float) -> None:
        """Pin both threads to a core, or to none, and ask for time slices of ``seconds`` for the main thread."""
        if seconds != self._turns:
            self._turns = seconds
            linux.ask_for_turns(seconds)
        if core != self._core:
            self._core = core
            with contextlib.suppress(OSError):  # the core has been taken from this process, for instance by a cpuset
                for thread in (os.getpid(), self._network_thread):
                    os.sched_setaffinity(thread, cpu_affinity.CORES if core is None else {core})

    # On the main thread -----------------------------------------------------------------------------------------------
    def run(self) -> None:
        """Run queued tasks and step the cell forever; the coordinator ends the process."""
        while True:
            self._run_tasks()
            assignment = self.assignment
            if assignment is None:
                continue
            # This also steps a cell that the network thread may step: whichever thread gets the lock does the work.
            while assignment.busy:
                self._carry_on(assignment)
                if not self.queue.empty() or assignment.bred_at >= self._stats_due:
                    break
            if assignment.cell.state == "running":
                self._do_what_is_due(assignment)

    def _run_tasks(self) -> None:
        """Wait for a task unless there is something else to do, and run all queued tasks."""
        if self.queue.empty():
            with contextlib.suppress(queue.Empty):
                self._run_task(self.queue.get(timeout=self._idle_seconds()))
        for _ in range(self.queue.qsize()):
            self._run_task(self.queue.get_nowait())

    def _run_task(self, task: Task) -> None:
        """Run a task. It may take long, so the node first hands on its core's token and lets other nodes breed."""
        self._turn_taking.hand_on()
        task()

    def _idle_seconds(self) -> float | None:
        """Return for how many seconds the main thread may wait for a task; None: without limit."""
        assignment = self.assignment
        if assignment is None or (assignment.cell.state != "running" and not assignment.events):
            return None
        if assignment.busy:
            return 0.0
        return max(0.0, self._main_thread_due(assignment) - time.monotonic())

    def _main_thread_due(self, assignment: Assignment) -> float:
        """Return when the main thread must look at the clock, on the monotonic clock.

        An inline cell's counters are sent by the network thread as long as it breeds, so here the main thread leaves
        it some time and wakes up only if the cell seems to wait.
        """
        return self._stats_due + (PATIENCE if assignment.inline else 0.0)

    def _carry_on(self, assignment: Assignment) -> None:
        """Step the cell on the main thread, or in async mode let compiled code breed to the end of this node's turn."""
        # Wait for the token before the lock: meanwhile the network thread may still let the cell read (`_take_in`).
        self._turn_taking.take_over(assignment)
        with assignment.turn:
            # In lockstep the network thread must not read into the inbox during this step. In async mode the path stays
            # open: there that thread only appends to the news, which needs no lock.
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
            # Give the network thread and the neighbours a chance to get this core (or the interpreter's lock). Without
            # it a node breeds hundreds of generations with the same immigrants before its time slice is over.
            cpu_affinity.stand_back()

    def _may_end_turn(self, assignment: Assignment) -> bool:
        """Return whether this turn needs nothing but breeding, so that one compiled call may fill it.

        Every generation must have a message (an interval of 1): the last one's then supersedes all before it.
        """
        return (
            self._turn_taking.has_turn
            and self._fast_path.is_open(assignment)
            and assignment.cell.plan.run.interval == 1
            and not assignment.events
            and not assignment.is_to_be_measured
        )

    def _do_what_is_due(self, assignment: Assignment) -> None:
        """Send counters and ask for missing messages when due.

        Both are as rare as the counters: code and data that are cold in the cache cost as much as some generations.
        """
        now = time.monotonic()
        if now < self._main_thread_due(assignment):
            return
        self._send_counters(assignment)
        if assignment.in_lockstep and now >= self._questions_due:
            self._ask_if_it_waits(assignment, now)

    def _ask_if_it_waits(self, assignment: Assignment, now: float) -> None:
        """Let a lockstep cell ask for missing messages when it waits far longer than usual; less and less often."""
        assignment.look_at_the_clock()  # generations of the fast path have not been noted yet
        waited, patience = now - assignment.bred_at, max(PATIENCE, 4 * assignment.gap)
        if waited >= patience:
            assignment.events.append(Waited())
        self._questions_due = now + max(patience - waited, waited, PATIENCE / 2)

    def _open_command(self, query: zenoh.Query, command: Command | Rejected) -> None:
        """Carry out a command and answer it; a command about a job or epoch unknown here gets no answer."""
        if isinstance(command, Rejected):
            _answer(query, Refused(f"node {self.config.node}: bad command: {command.reason}"))
        elif isinstance(command, Prepare):
            if self.config.node in command.wiring.nodes:
                _answer(query, self._prepare(command))
            else:
                self._drop_query(query)
        elif isinstance(command, Drop):
            self._forget(command.job)
            _answer(query, Done())
        elif isinstance(command, Begin):
            self._begin(command, query)
        elif isinstance(command, Look):
            self._answer_look(command, query)
        else:
            for assignment in (self.assignment, self.past):
                if assignment is not None and (assignment.job, assignment.epoch) == (command.job, command.epoch):
                    return self._obey(assignment, command, query)
            self._drop_query(query)
        return None

    def _answer_look(self, command: Look, query: zenoh.Query) -> None:
        """Answer a new coordinator that looks for the nodes of a job."""
        if self.assignment is not None and self.assignment.job == command.job:
            _answer(query, Done(json.dumps({"cell": self.assignment.cell.cell, "versions": fingerprint()})))
        else:
            self._drop_query(query)

    def _drop_query(self, query: zenoh.Query) -> None:
        """End a query without an answer: commands reach every node, and this one was meant for others."""
        query.drop()  # type: ignore[no-untyped-call]

    def _obey(self, assignment: Assignment, command: Command, query: zenoh.Query) -> None:
        """Carry out a command for an epoch that this node is in or has just left."""
        if isinstance(command, ProposeStop):
            assignment.events.append(Propose(command.reason))
            _answer(query, Done())
        elif isinstance(command, Missed):
            assignment.events.append(Asked(command.generation, query))
            if assignment is self.past:  # `run` steps the present epoch only
                self._carry_on(assignment)
        elif isinstance(command, Halt):
            assignment.events.append(Halted())
            self._answer_with_report(assignment, query)
        else:
            _answer(query, Refused("that is a command for the spy"))

    def _prepare(self, command: Prepare) -> Done | Refused:
        """Get ready for an epoch: a job's first one becomes the assignment, a later one waits as `coming`."""
        # A node that is given a deme takes the place of one that died, so it does not go on with a deme of its own.
        goes_on = self._has_lived_before(command) and not command.deme
        if not goes_on and self.assignment is not None:
            self._forget(self.assignment.job)
        self.coming = None
        try:
            file = self.config.modules.read(command.file)
            plan = Plan.of(file, command.epoch, command.since or 0, checked=True)
            # The deme must fit the new epoch's genomes. Of a user's own problem the coordinator cannot check that,
            # since it does not import the user's module.
            if goes_on and self.assignment is not None and not command.fresh:
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
                self._fast_path.close(self.assignment)  # it puts a message among the news without reading its epoch
        else:
            self.assignment = Assignment(cell, links)
        return Done(json.dumps(fingerprint()))

    def _has_lived_before(self, command: Prepare) -> bool:
        """Return whether this node is in an earlier epoch of that job.

        If it is in the same epoch already, because the command came twice, it prepares anew.
        """
        assignment = self.assignment
        return assignment is not None and assignment.job == command.job and assignment.epoch < command.epoch

    def _keep(self, links: Links) -> None:
        """Keep these links for the next epochs; close the previous ones unless the present epoch still needs them."""
        before, self.links = self.links, links
        if (
            before is not None
            and before is not links
            and (self.assignment is None or self.assignment.links is not before)
        ):
            before.close()

    def _begin(self, command: Begin, query: zenoh.Query) -> None:
        """Begin an epoch. If asked again, as by a coordinator that takes over, report to the latest query only."""
        assignment, coming = self.assignment, self.coming
        if coming is not None and (coming.job, coming.plan.epoch) == (command.job, command.epoch):
            coming.begun = query
            self._enter_next_epoch()
        elif assignment is not None and (assignment.job, assignment.epoch) == (command.job, command.epoch):
            if assignment.cell.state == "prepared":
                self._start(assignment, Start())
            self._answer_with_report(assignment, query)
        elif self.past is not None and (self.past.job, self.past.epoch) == (command.job, command.epoch):
            self._answer_with_report(self.past, query)  # the report may have been lost the first time
        else:
            self._drop_query(query)

    def _start(self, assignment: Assignment, start: Start) -> None:
        assignment.bred_at = time.monotonic()
        assignment.told = (assignment.bred_at, 0, 0)
        self._questions_due = assignment.bred_at + PATIENCE
        assignment.events.append(start)

    def _answer_with_report(self, assignment: Assignment, query: zenoh.Query) -> None:
        """Answer with the cell's report, now or when the cell stops."""
        if assignment.begun is not None:
            self._drop_query(assignment.begun)
        assignment.begun = query
        self._report(assignment)

    def _report(self, assignment: Assignment) -> None:
        if assignment.report is not None and assignment.begun is not None:
            with assignment.begun as query:
                query.reply(query.key_expr, assignment.report)
            assignment.begun = None

    def _enter_next_epoch(self) -> None:
        """Move to the coming epoch if it has been begun and the present one has stopped; its deme moves along."""
        before, coming = self.assignment, self.coming
        if coming is None or coming.begun is None or (before is not None and not before.cell.ended):
            return
        # Only this node knows after which generation its cell stopped, so the coordinator leaves `since` open.
        bred = 0 if before is None else before.cell.plan.since + before.cell.rows.generation
        plan = replace(coming.plan, since=bred if coming.since is None else coming.since)
        if coming.fresh:
            genomes = None
        else:
            genomes = before.cell.rows.genomes[0] if before is not None else plan.deme_of(coming.deme)
        assignment = Assignment(Cell(plan, coming.links.cell, coming.job), coming.links, coming.news)
        self._drop_past()  # kept until now: neighbours and coordinator may have asked how it ended
        self.past, self.assignment, self.coming = before, assignment, None
        assignment.begun = coming.begun
        self._start(assignment, Start(genomes))

    def _drop_past(self) -> None:
        """Forget the past epoch and close its links, unless a later epoch uses them too."""
        past, self.past = self.past, None
        in_use = (self.links, None if self.assignment is None else self.assignment.links)
        if past is not None and past.links not in in_use:
            past.links.close()

    def _forget(self, job: int) -> None:
        """Forget a job. The latest links stay open, since the next job may want the same ones."""
        assignment = self.assignment
        if assignment is not None and assignment.job == job:
            with assignment.turn:  # the network thread may be stepping the cell
                self._fast_path.forget(assignment)
                self.assignment = None
                self._pin(None, 0.0)
            self._drop_past()
            if assignment.links is not self.links:
                assignment.links.close()
        if self.coming is not None and self.coming.job == job:
            self.coming = None

    def _carry_out(self, assignment: Assignment, action: Action) -> None:
        """Carry out an action other than `Publish`; each of these may block."""
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
            else:
                # The last counters leave before the report. A cell that failed may have no individuals to count.
                self._send_counters(assignment)
            assignment.report = action.encode()
            self._report(assignment)
            self._enter_next_epoch()

    def _ask(self, assignment: Assignment, action: Ask) -> None:
        """Ask a neighbour, through the router, for a message that has not come by the direct link."""

        def hear(reply: zenoh.Reply) -> None:  # on a thread of Zenoh's
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
        """Publish a log record about this node's cell."""
        node, generation = self.config.node, cell.plan.since + cell.rows.generation
        record = LogRecord(level, f"node {node}", text, time.time(), node, cell.cell, cell.job, generation)
        self.control.put(self.keys.log, record.encode())

    def _send_counters(self, assignment: Assignment) -> None:
        """Publish this node's counters, on the thread that breeds or, beside it, on the main thread."""
        cell, (each_exchange, each_generation) = assignment.cell, assignment.seconds_since_told()
        least = _GENERATIONS_BETWEEN_COUNTERS * each_generation if assignment.hands_on else 0.0
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
    """Do nothing: a task that only wakes the main thread."""


def _fail(error: Exception) -> None:
    """Raise on the main thread an error of the network thread, so that it ends the process."""
    raise error


def _answer(query: zenoh.Query, answer: Done | Refused) -> None:
    with query:
        query.reply(query.key_expr, control.encode_answer(answer))
