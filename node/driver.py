"""The data path of a node: when the cell of its present epoch takes a step, and on which of its two threads.

Messages come in by the callbacks that `Driver.make_handler` returns; what the cell says goes out by the assignment's
links, and by ``carry_out``. So a test can drive a cell without a network. `node.process` states which thread may touch
what.
"""

import contextlib
import queue
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

import zenoh

from lowlevel import capabilities
from node import cpu_affinity
from node.assignment import MANY_UNREAD, Assignment, Coming
from node.events import Action, Publish, Start, Waited
from node.links import Hear, Task
from node.ordinary_path import OrdinaryPath
from node.telemetry import Telemetry
from node.turn_taking import TurnTaking

if TYPE_CHECKING:
    from node.fast_path import FastPath

_AWAKE_AFTER = 1.0  # s after it was due that the main thread wakes up although the network thread could do its work
MOST_UNREAD = 1000  # messages: a lockstep node reads so many even if a neighbour has sent nothing, to bound memory


def make_fast_path() -> "FastPath | OrdinaryPath":
    """Make the fast path of a node, or what stands in for it where it must not be used."""
    if not capabilities().c_api:
        return OrdinaryPath()
    from node.fast_path import FastPath

    return FastPath()


class Driver:
    """Steps the cell of a node's present epoch, and runs the node's other tasks in between.

    Args:
        carry_out: carries out an action other than `Publish`. It is called on the main thread and may block.
        telemetry: sends the counters when they are due.
        turn_taking: the node's turns on its core.
        fast_path: takes messages in compiled code where that is possible.
        pin: pins this process's threads to a core, or to none, and sets the main thread's time slice in seconds.

    Attributes:
        queue: tasks for the main thread.
        assignment: the epoch that this node is in; None while it has no job.
        coming: the next epoch, prepared but not begun.
    """

    def __init__(
        self,
        carry_out: Callable[[Assignment, Action], None],
        telemetry: Telemetry,
        turn_taking: TurnTaking,
        fast_path: "FastPath | OrdinaryPath",
        pin: Callable[[int | None, float], None],
    ) -> None:
        self.queue: queue.SimpleQueue[Task] = queue.SimpleQueue()
        self.assignment: Assignment | None = None
        self.coming: Coming | None = None
        self._carry_out = carry_out
        self._telemetry = telemetry
        self._turn_taking = turn_taking
        self._fast_path = fast_path
        self._pin = pin

    # On the network thread --------------------------------------------------------------------------------------------
    def make_handler(self, sender: int) -> Hear:
        """Return the callback for messages of the cell ``sender``: the fast path while that is open, else `hear`."""
        return self._fast_path.make_handler(sender, partial(self.hear, sender))

    def hear(self, sender: int, sample: zenoh.Sample) -> None:
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
        # first, then discard: `find_missing_senders` replaces the set first and reads the news afterwards, so the
        # sender is absent from whichever set counts. A stale set costs a step in vain at most, never a missed one.
        if self._fast_path.close(assignment):
            assignment.find_missing_senders()  # the fast path has read messages without updating them
        missing = assignment.missing_senders
        missing.discard(sender)
        if not missing or len(news) > MOST_UNREAD:  # otherwise a step would find a message missing
            if assignment.inline:
                self._carry_on_inline(assignment)
            else:
                self.queue.put(wake)

    def _take_in(self, assignment: Assignment) -> None:
        """In async mode let the cell read its unread messages, to bound memory while the main thread waits for a core.

        If the main thread holds the lock, this does nothing: that thread reads them in its next step.
        """
        if assignment.lock.acquire(False):
            try:
                for action in assignment.take_in():
                    self.queue.put(partial(self._carry_out, assignment, action))
            except Exception as error:
                self.queue.put(partial(_fail, error))
            finally:
                assignment.lock.release()

    def _carry_on_inline(self, assignment: Assignment) -> None:
        """Step the cell on the network thread for as long as it can breed.

        If the main thread holds the lock, this returns: that thread looks for messages again after its step. Nothing
        here may block, so everything except small messages to neighbours and counters is queued for the main thread.
        """
        while assignment.lock.acquire(False):
            if assignment is not self.assignment:  # the main thread has left it meanwhile, and closes its links
                assignment.lock.release()
                return
            self._step_inline(assignment, assignment.step)  # releases the lock
            if not assignment.inline:  # generations have become long: the main thread takes over
                self.queue.put(wake)
                return
            if not assignment.busy:  # a neighbour may be one exchange ahead, so the next step may be possible already
                return

    def _finish_fast_path(self, assignment: Assignment) -> None:
        """Finish what the fast path has left to Python; it has acquired the assignment's lock, this releases it."""
        self._step_inline(assignment, assignment.actions_after_breeding)
        if assignment.busy:
            self._carry_on_inline(assignment)

    def _step_inline(self, assignment: Assignment, step: Callable[[], list[Action]]) -> None:
        """Take one step on the network thread; the caller has acquired the assignment's lock, this releases it."""
        try:
            self._fast_path.close(assignment)  # one of the two is at the cell; `_open_fast_path` opens it afresh
            for action in step():
                if type(action) is Publish:
                    assignment.links.publish(action)
                else:
                    self.queue.put(partial(self._carry_out, assignment, action))
            if assignment.bred_at >= self._telemetry.due:
                self._telemetry.send_counters(assignment)
            self._keep_to(assignment)
            self._open_fast_path(assignment)
        except Exception as error:  # raised here it would end in Zenoh's callback; the main thread ends the process
            self.queue.put(partial(_fail, error))
        finally:
            assignment.lock.release()

    def _open_fast_path(self, assignment: Assignment) -> None:
        """Open the fast path if the coming messages may take it, else close it; requires the assignment's lock."""
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
            # The ordinary path then takes the next messages, and needs `missing_senders` to be right again.
            if assignment.busy and self._fast_path.close(assignment):
                assignment.find_missing_senders()

    def _keep_to(self, assignment: Assignment) -> None:
        """Apply the assignment's core and time slice; requires its lock. A past epoch no longer decides them."""
        if assignment is self.assignment:
            self._pin(assignment.core, assignment.slice_seconds)

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
                self.carry_on(assignment)
                if not self.queue.empty() or assignment.bred_at >= self._telemetry.due:
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
        due = self._main_thread_due(assignment)
        if assignment.in_lockstep and assignment.patience.is_hasty:
            due = min(due, assignment.patience.due)
        return max(0.0, due - time.monotonic())

    def _main_thread_due(self, assignment: Assignment) -> float:
        """Return when the main thread must look at the clock, on the monotonic clock.

        An inline cell's counters are sent by the network thread as long as it breeds, so here the main thread leaves
        it some time and wakes up only if the cell seems to wait.
        """
        return self._telemetry.due + (_AWAKE_AFTER if assignment.inline else 0.0)

    def carry_on(self, assignment: Assignment) -> None:
        """Step the cell on the main thread, or in async mode let compiled code breed to the end of this node's turn."""
        # Wait for the token before the lock: meanwhile the network thread may still let the cell read (`_take_in`).
        self._turn_taking.take_over(assignment)
        with assignment.lock:
            # In lockstep the network thread must not read into the inbox during this step. In async mode the path stays
            # open: there that thread only appends to the news, which needs no lock.
            if assignment.in_lockstep:
                self._fast_path.close(assignment)
            if self._may_end_turn(assignment) and self._fast_path.end_turn(self._turn_taking.over_at):
                actions = assignment.actions_after_breeding()
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
        if not assignment.in_lockstep and assignment.slice_seconds != cpu_affinity.LONG:
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
        now, patience = time.monotonic(), assignment.patience
        is_due = now >= self._main_thread_due(assignment)
        if is_due:
            self._telemetry.send_counters(assignment)
        if assignment.in_lockstep and now >= patience.due and (is_due or patience.is_hasty):
            assignment.look_at_the_clock()  # generations of the fast path have not been noted yet
            if patience.is_over(now, assignment.bred_at):
                assignment.events.append(Waited())

    def enter(self, assignment: Assignment) -> None:
        """Make an assignment the present one; none is coming then."""
        # In this order, since `hear` looks at `coming` first: a message that comes in between may be among the news
        # twice, and the second one is of no use. In the other order it could be lost.
        self.assignment = assignment
        self.coming = None

    def expect(self, coming: Coming) -> None:
        """Let the next epoch hear messages from now on, beside the present one."""
        self.coming = coming
        if self.assignment is not None and not self.assignment.in_lockstep:
            self._fast_path.close(self.assignment)  # it puts a message among the news without reading its epoch

    def start(self, assignment: Assignment, start: Start) -> None:
        """Let the cell of an assignment begin."""
        assignment.bred_at = time.monotonic()
        assignment.last_report = (assignment.bred_at, 0, 0)
        others_wait = start.takeover is not None and start.takeover.others_wait
        assignment.patience.begin(assignment.bred_at, took_over=others_wait)
        assignment.events.append(start)

    def leave(self, assignment: Assignment) -> None:
        """Leave an assignment, the present one, for none."""
        with assignment.lock:  # the network thread may be stepping the cell
            self._fast_path.forget(assignment)
            self.assignment = None
            self._pin(None, 0.0)


def wake() -> None:
    """Do nothing: a task that only wakes the main thread."""


def _fail(error: Exception) -> None:
    """Raise on the main thread an error of the network thread, so that it ends the process."""
    raise error
