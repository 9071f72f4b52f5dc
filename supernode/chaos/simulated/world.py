"""The clock of a simulated cluster, its processes and their threads, each a task that runs until it waits.

One task runs at a time, and only a wait lets another one run. Simulated time passes only while all tasks wait. So a run
depends on nothing but the seed, and a second of it costs no more than what happens in it.

Which task goes on first, and how long after it could, is drawn: that finds the orders of events that real threads take
rarely. A task that never waits would stop the world, so everything that a real thread may be interrupted at, such as a
message that it sends, costs it a drawn time.
"""

import hashlib
import heapq
import itertools
import random
from collections.abc import Callable
from functools import partial
from typing import Any

from greenlet import GreenletExit, getcurrent, greenlet

EPOCH = 1_700_000_000.0
"""The Unix time at which a simulation begins."""

_FIRST_ID = 10_000_000  # of processes: more than Linux gives, so that none is taken for a real one
_SWITCH = 20e-6  # seconds: mean time from the moment when a task may go on until it does
_SLOW = 0.002  # share of the switches that take much longer, as on a busy core
_SLOW_SECONDS = 0.02  # seconds: the most that those take


class Process:
    """A simulated process: its tasks run until it is killed, and rest while it is stopped.

    Attributes:
        world: the world that it lives in.
        name: such as "node 3".
        id: the process id.
        alive: whether it has not ended.
        at_end: called when it ends, as the kernel closes its sockets and files.
        status: its exit status, once it has ended by itself.
        handlers: what it does at signals that it handles.
    """

    def __init__(self, world: "World", name: str) -> None:
        self.world = world
        self.name = name
        self.id = next(world.process_ids)
        self.alive = True
        self.stopped_until = 0.0
        self.at_end: list[Callable[[], None]] = []
        self.tasks: set[Task] = set()
        self.status: int | None = None
        self.handlers: dict[int, Callable[[int, None], object]] = {}

    def start(self, run: Callable[[], object], name: str) -> "Task":
        """Start a task of this process."""
        task = Task(self, run, name)
        self.tasks.add(task)
        self.world.wake(task)
        return task

    def signal(self, number: int) -> None:
        """Send a signal that the process handles; it is ignored if it does not, or does not yet."""
        handler = self.handlers.get(number)
        if handler is not None and self.alive:
            self.start(partial(handler, number, None), "signal")

    def exit(self, status: int) -> None:
        """End the process, whose task calls this, as `os._exit` does."""
        self.status = status
        self.world.at(self.world.now, lambda: self.world.exited(self))
        self.world.wait()

    def kill(self) -> None:
        """End the process at once, as SIGKILL does: nothing that it does from now on has an effect."""
        if not self.alive:
            return
        self.alive = False
        for task in sorted(self.tasks, key=lambda task: task.number):
            task.end()
        for end in self.at_end:
            end()

    def stop(self, seconds: float) -> None:
        """Let the process rest for so long, as between SIGSTOP and SIGCONT."""
        self.stopped_until = max(self.stopped_until, self.world.now + seconds)


class Task:
    """A thread of a simulated process.

    Attributes:
        process: whose thread it is.
        name: of the thread, for the log.
        is_done: whether it has ended.
        joiners: tasks that wait for its end.
    """

    def __init__(self, process: Process, run: Callable[[], object], name: str) -> None:
        self.process = process
        self.name = name
        self.number = next(process.world.task_numbers)
        self.is_done = False
        self.joiners: list[Task] = []
        self.waits = 1  # how often it has waited; an entry of the agenda for an earlier wait is void
        self.was_woken = False
        self._run = run
        self.greenlet = greenlet(self._live, process.world.hub)

    def _live(self) -> None:
        try:
            self._run()
        except GreenletExit:
            pass
        except BaseException as error:
            self.process.world.task_failed(self, error)
        finally:
            self.is_done = True
            self.process.tasks.discard(self)
            for task in self.joiners:
                self.process.world.wake(task)

    def end(self) -> None:
        """End the task where it waits. It cannot do anything more: `World.wait` ends it again."""
        if self.greenlet is getcurrent():  # a process that kills itself: it ends at its next wait
            return
        if self.greenlet:  # it has begun and not ended
            self.greenlet.throw()
        self.is_done = True


class World:
    """The clock and the scheduler.

    Args:
        seed: the same seed gives the same run.
        failed: called with a process one of whose tasks ended by an exception, the task's name and the exception.
        exited: called with a process that has ended by itself.

    Attributes:
        now: seconds since the world began.
        draw: the source of all random draws.
        hub: the greenlet that runs the agenda.
        events: how often something has happened.
        log: what was said, a line each.
        mask: a text that differs from run to run, such as the path of a folder; it counts as "state".
    """

    def __init__(
        self,
        seed: int,
        failed: Callable[[Process, str, BaseException], None],
        exited: Callable[[Process], None],
    ) -> None:
        self.now = 0.0
        self.draw = random.Random(seed)
        self.hub = getcurrent()
        self.process_ids = itertools.count(_FIRST_ID)
        self.task_numbers = itertools.count()
        self.events = 0
        self.mask = "nothing is masked"
        self.log: list[str] = []
        self._failed = failed
        self.exited = exited
        self._order = itertools.count()
        self._agenda: list[tuple[float, int, Task | Callable[[], None], int]] = []
        self._current: Task | None = None
        self._digest = hashlib.sha256()

    # For the hub ------------------------------------------------------------------------------------------------------
    def run(self, over: Callable[[], bool], until: float) -> bool:
        """Let things happen until ``over`` returns True, or the clock shows ``until``; return whether it did."""
        while not over():
            if not self._agenda or self._agenda[0][0] > until:
                self.now = until
                return False
            at, _, what, wait = heapq.heappop(self._agenda)
            self.now = max(self.now, at)
            if isinstance(what, Task):
                self._let_go_on(what, wait)
            else:
                self.events += 1
                what()
        return True

    def _let_go_on(self, task: Task, wait: int) -> None:
        if task.is_done or task.waits != wait or not task.process.alive:
            return
        if task.process.stopped_until > self.now:
            heapq.heappush(self._agenda, (task.process.stopped_until, next(self._order), task, wait))
            return
        self.events += 1
        self._current = task
        task.greenlet.switch()
        self._current = None

    def at(self, when: float, what: Callable[[], None]) -> None:
        """Call ``what`` on the hub at a time; it must not wait."""
        heapq.heappush(self._agenda, (when, next(self._order), what, 0))

    def end(self) -> None:
        """Forget all that would have happened."""
        self._agenda.clear()

    # For tasks --------------------------------------------------------------------------------------------------------
    @property
    def current(self) -> Task:
        """The task that runs."""
        assert self._current is not None, "no task runs: the hub must not wait"
        return self._current

    @property
    def process(self) -> Process | None:
        """The process of the task that runs; None on the hub."""
        return None if self._current is None else self._current.process

    def wait(self, until: float | None = None) -> bool:
        """Wait for `wake`, at most until a time; return whether it came."""
        task = self.current
        if not task.process.alive:
            raise GreenletExit
        task.waits += 1
        task.was_woken = False
        if until is not None:
            heapq.heappush(self._agenda, (max(until, self.now), next(self._order), task, task.waits))
        self.hub.switch()
        if not task.process.alive:
            raise GreenletExit
        return task.was_woken

    def wake(self, task: Task) -> None:
        """Let a task go on soon."""
        if not task.was_woken:
            task.was_woken = True
            heapq.heappush(self._agenda, (self.now + self._delay(), next(self._order), task, task.waits))

    def sleep(self, seconds: float) -> None:
        """Let so many seconds pass, and at least what a change of tasks takes."""
        until = self.now + max(seconds, self._delay())
        while self.now < until:
            self.wait(until)

    def spend(self, seconds: float) -> None:
        """Let the running task work for about so long; does nothing on the hub."""
        if self._current is not None:
            self.sleep(self.draw.uniform(0.5, 2.0) * seconds)

    def _delay(self) -> float:
        if self.draw.random() < _SLOW:
            return self.draw.uniform(0.0, _SLOW_SECONDS)
        return self.draw.expovariate(1.0 / _SWITCH)

    def task_failed(self, task: Task, error: BaseException) -> None:
        """Note that a task has ended by an exception."""
        if task.process.alive:
            self.say(f"{task.process.name}: {task.name} raised {type(error).__name__}: {error}")
            process, name = task.process, task.name
            self.at(self.now, lambda: self._failed(process, name, error))

    # The log ----------------------------------------------------------------------------------------------------------
    def say(self, line: str) -> None:
        """Add a line to the log."""
        self.log.append(f"{self.now:11.6f}  {line.replace(self.mask, 'state')}")
        self.note(line)

    def note(self, *what: Any) -> None:
        """Add something to the digest of everything that happens."""
        self._digest.update(repr((round(self.now, 9), what)).replace(self.mask, "state").encode())

    @property
    def digest(self) -> str:
        """A digest of everything that has happened so far."""
        return self._digest.hexdigest()
