"""Stand-ins for `threading`, `queue` and `time` on the tasks of a `World`."""

import collections
import queue
import types
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

from supernode.chaos.simulated.world import EPOCH, Task, World

_LOCK = 1e-6  # seconds that a lock or a queue takes
_INTERRUPTED = 0.05  # share of these at which another thread may run


class ThreadTypes:
    """Makes the stand-ins for one world.

    Attributes:
        threading: instead of the module of that name; likewise ``queue`` and ``time``.
    """

    def __init__(self, world: World) -> None:
        self.threading = types.SimpleNamespace(
            Lock=lambda: _Lock(world),
            RLock=lambda: _RLock(world),
            Condition=lambda lock=None: _Condition(world, lock),
            Event=lambda: _Event(world),
            Thread=lambda *args, **kwargs: _Thread(world, *args, **kwargs),
            get_native_id=lambda: 0,
            TIMEOUT_MAX=1e9,
        )
        self.queue = types.SimpleNamespace(
            SimpleQueue=lambda: SimpleQueue(world), Queue=lambda maxsize=0: SimpleQueue(world), Empty=queue.Empty
        )
        self.time = types.SimpleNamespace(
            monotonic=lambda: world.now,
            perf_counter=lambda: world.now,
            time=lambda: EPOCH + world.now,
            time_ns=lambda: int((EPOCH + world.now) * 1e9),
            process_time=lambda: 0.0,
            thread_time=lambda: 0.0,
            sleep=world.sleep,
        )


def _interrupt(world: World) -> None:
    """Let other tasks run here, as threads may be interrupted anywhere; not each time, since that takes long."""
    if world.process is not None and world.draw.random() < _INTERRUPTED:
        world.spend(_LOCK)


def _wait_in(line: collections.deque[Task], world: World, until: float | None) -> None:
    """Wait in a line of tasks until somebody takes this one out and wakes it, or until a time."""
    task = world.current
    line.append(task)
    world.wait(until)
    if task in line:  # else a wake that is meant for a task that waits would be lost on this one later
        line.remove(task)


class _Lock:
    def __init__(self, world: World) -> None:
        self._world = world
        self._owner: Task | None = None
        self._waiting: collections.deque[Task] = collections.deque()

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        world = self._world
        _interrupt(world)
        until = None if timeout < 0 else world.now + timeout
        while self._owner is not None:
            if not blocking or (until is not None and world.now >= until):
                return False
            _wait_in(self._waiting, world, until)
        self._owner = world.current
        return True

    def release(self) -> None:
        self._owner = None
        while self._waiting:
            task = self._waiting.popleft()
            if not task.is_done:
                self._world.wake(task)
                return

    def locked(self) -> bool:
        return self._owner is not None

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class _RLock:
    def __init__(self, world: World) -> None:
        self._world = world
        self._lock = _Lock(world)
        self._depth = 0

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        if self._lock._owner is not None and self._lock._owner is self._world.current:
            self._depth += 1
            return True
        if not self._lock.acquire(blocking, timeout):
            return False
        self._depth = 1
        return True

    def release(self) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._lock.release()

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()

    def give_up(self) -> int:
        """Release the lock whatever the depth, and return that."""
        depth, self._depth = self._depth, 0
        self._lock.release()
        return depth

    def take_again(self, depth: int) -> None:
        self._lock.acquire()
        self._depth = depth


class _Condition:
    def __init__(self, world: World, lock: _RLock | None = None) -> None:
        self._world = world
        self._lock = _RLock(world) if lock is None else lock
        self._waiting: list[Task] = []

    def __enter__(self) -> bool:
        return self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def wait(self, timeout: float | None = None) -> bool:
        world, task = self._world, self._world.current
        until = None if timeout is None else world.now + timeout
        self._waiting.append(task)
        depth = self._lock.give_up()
        try:
            while task in self._waiting and (until is None or world.now < until):
                world.wait(until)
        finally:
            self._lock.take_again(depth)
        if task in self._waiting:
            self._waiting.remove(task)
            return False
        return True

    def wait_for(self, condition: Callable[[], Any], timeout: float | None = None) -> Any:
        until = None if timeout is None else self._world.now + timeout
        while not (result := condition()):
            left = None if until is None else until - self._world.now
            if left is not None and left <= 0:
                break
            self.wait(left)
        return result

    def notify(self, n: int = 1) -> None:
        woken, self._waiting = self._waiting[:n], self._waiting[n:]
        for task in woken:
            self._world.wake(task)

    def notify_all(self) -> None:
        self.notify(len(self._waiting))


class _Event:
    def __init__(self, world: World) -> None:
        self._world = world
        self._is_set = False
        self._waiting: list[Task] = []

    def is_set(self) -> bool:
        return self._is_set

    def set(self) -> None:
        self._is_set = True
        woken, self._waiting = self._waiting, []
        for task in woken:
            self._world.wake(task)

    def clear(self) -> None:
        self._is_set = False

    def wait(self, timeout: float | None = None) -> bool:
        world = self._world
        until = None if timeout is None else world.now + timeout
        while not self._is_set and (until is None or world.now < until):
            self._waiting.append(world.current)
            world.wait(until)
        return self._is_set


class _Thread:
    def __init__(
        self,
        world: World,
        group: None = None,
        target: Callable[..., object] | None = None,
        name: str | None = None,
        args: Iterable[Any] = (),
        kwargs: Mapping[str, Any] | None = None,
        *,
        daemon: bool | None = None,
    ) -> None:
        assert target is not None
        self._world = world
        self._call = partial(target, *args, **(kwargs or {}))
        self.name = name or "thread"
        self._task: Task | None = None

    def start(self) -> None:
        process = self._world.process
        assert process is not None, "only a process starts threads"
        self._task = process.start(self._run, self.name)

    def _run(self) -> None:
        self._call()

    def join(self, timeout: float | None = None) -> None:
        world, task = self._world, self._task
        if task is None:
            raise RuntimeError("cannot join thread before it is started")
        until = None if timeout is None else world.now + timeout
        while not task.is_done and (until is None or world.now < until):
            task.joiners.append(world.current)
            world.wait(until)

    def is_alive(self) -> bool:
        return self._task is not None and not self._task.is_done


class SimpleQueue:
    """Instead of `queue.SimpleQueue`; the hub may put things into it too."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._items: collections.deque[Any] = collections.deque()
        self._waiting: collections.deque[Task] = collections.deque()

    def put(self, item: Any) -> None:
        """Append an item."""
        self._items.append(item)
        while self._waiting:
            task = self._waiting.popleft()
            if not task.is_done:
                self._world.wake(task)
                break
        _interrupt(self._world)

    def get(self, block: bool = True, timeout: float | None = None) -> Any:
        """Take the first item; wait for it, at most ``timeout`` seconds.

        Raises:
            queue.Empty: if there is none.
        """
        world = self._world
        until = None if timeout is None else world.now + timeout
        while not self._items:
            if not block or (until is not None and world.now >= until):
                raise queue.Empty
            _wait_in(self._waiting, world, until)
        return self._items.popleft()

    def get_nowait(self) -> Any:
        """Take the first item.

        Raises:
            queue.Empty: if there is none.
        """
        return self.get(False)

    def empty(self) -> bool:
        """Return whether there is no item."""
        return not self._items

    def qsize(self) -> int:
        """Return the number of items."""
        return len(self._items)
