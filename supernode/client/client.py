"""Clients of a running cluster: a blocking one and one for asyncio.

::

    with supernode.connect() as client:
        job = client.submit("examples/arm-ik.toml", seed=1, seconds=5)
        for best in job.improvements():
            print(best.fitness, best.feasible, best.solution)
        result = job.result()

`AsyncClient` is the implementation; it runs on the asyncio loop of its caller. `Client` wraps an `AsyncClient` that
runs on a loop of its own, in a background thread, so both behave the same.

Only the loop touches the state of a client and its jobs. Zenoh delivers messages on threads of its own; `Link` hands
them to the loop. Therefore nothing here needs a lock.
"""

import asyncio
import contextlib
import json
import secrets
import threading
import weakref
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any, Self, TypeVar

from coordinator.errors import ClusterFailed
from coordinator.states import ENDS
from problems import ProblemFile, load
from problems.errors import UPDATE_OF, BadInput
from problems.file import filled_in, load_patch
from supernode.client.cluster_info import Place
from supernode.client.job_feed import WAITING, JobFeed, improvement_in
from supernode.client.link import PATIENCE, Link
from wire import jobs as wire
from wire.keys import Keys
from wire.news import Improvement
from wire.strict import Rejected

if TYPE_CHECKING:
    from spy.result import Result

_Value = TypeVar("_Value")
_GONE_WITHIN = 5.0  # seconds to wait for an answer to `down`: the coordinator may exit before its answer has left
_BEGUN_WITHIN = 2.0  # seconds after which an epoch is taken to have begun even if no message said so (one may be lost)


def _imported_results() -> ModuleType:
    from supernode.runs import results

    return results


def connect(endpoint_or_state: str | Path | None = None) -> "Client":
    """Connect to a running cluster and return a blocking client.

    Args:
        endpoint_or_state: an endpoint such as ``"tcp/127.0.0.1:7447"``, or the state folder of a `supernode up` on this
            machine. None means the user's default state folder.

    Returns:
        A client; use it as a context manager, or call its `close`.

    Raises:
        ClusterFailed: if no cluster is found there within two seconds, or if the cluster does not answer.
    """
    return Client(Place.of(endpoint_or_state))


async def connect_async(endpoint_or_state: str | Path | None = None) -> "AsyncClient":
    """Connect to a running cluster and return a client for asyncio.

    Arguments and errors are those of `connect`.
    """
    return await AsyncClient.open(Place.of(endpoint_or_state))


class AsyncClient:
    """A client of a running cluster for programs that use asyncio; an async context manager.

    `supernode.connect_async` makes one. Use it, and the jobs that it returns, only on the loop that it was made on.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._loop = asyncio.get_running_loop()
        # Weak: a feed lives as long as a handle of its job, so a client that runs for weeks does not collect feeds.
        self._feeds: weakref.WeakValueDictionary[str, JobFeed] = weakref.WeakValueDictionary()
        self._improvement_listeners: list[Callable[[Improvement], None]] = []
        self._closed = False
        self._results: asyncio.Task[Any] | None = None
        link.listen(link.keys.best, self._hear_best)
        link.listen(link.keys.state, self._hear_state)

    @classmethod
    async def open(cls, place: Place) -> Self:
        """Connect to the cluster at ``place``; see `connect_async`."""
        return cls(await Link.open(place))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def submit(
        self, file: ProblemFile | str | Path, *, id: str | None = None, priority: int = 0, **run: Any
    ) -> "AsyncClientJob":
        """Submit a job and return a handle of it once the cluster has stored it.

        Args:
            file: a problem file from `supernode.load`, or the path of one.
            id: an id of your choice: 1 to 64 letters, digits, dots, hyphens and underscores. To submit the same problem
                again under the same id is safe: it is the same job. None picks a random id.
            priority: jobs of a higher priority leave the queue first; at most a million in either direction.
            run: settings that replace those of the file's ``[run]`` table, such as ``seed=1`` or ``seconds=5``.

        Raises:
            BadInput: if the file, a setting or the id is wrong, or if the cluster refuses the job.
            ClusterFailed: if the cluster does not answer.
        """
        # In a thread: loading may read large files and import a user's module, which would block the loop.
        loaded = file if isinstance(file, ProblemFile) else await asyncio.to_thread(load, file)
        asked = loaded.with_run(**run)
        asked.refuse_unreachable()
        text = asked.to_json()
        # The feed exists before the request is sent, so improvements that overtake the answer are not lost.
        feed = self._feed(secrets.token_hex(4) if id is None else id)
        await self.ask(wire.Submit(text, feed.job, priority))
        return AsyncClientJob(self, feed)

    async def jobs(self, limit: int | None = None) -> list[dict[str, Any]]:
        """Return a summary of each job the cluster knows, newest last.

        Args:
            limit: return only the newest ``limit`` jobs; None returns all that fit into one answer.

        Returns:
            One map for each job, with its "job" (id), "status", "kind", "fitness" and more; see docs/protocol.md.
        """
        listed: list[dict[str, Any]] = await self.ask(wire.ListJobs(limit))
        return listed

    async def job(self, id: str) -> "AsyncClientJob":
        """Return a handle of a job that was submitted before, by this or another client.

        Raises:
            BadInput: if the cluster knows no job of that id.
        """
        feed = self._feed(id)
        await self.look(feed)
        return AsyncClientJob(self, feed)

    async def records(self, kind: str, job: str, after: int = 0) -> dict[str, Any]:
        """Return one page of the records of a job, oldest first.

        Args:
            kind: "improvements" are the verified improvements as the spy received them, without their solutions.
                "history" are the improvements that the cells recorded, of epochs that have ended; equal lockstep runs
                have equal ones. "statistics" are one row for each second of the job.
            job: the job's id.
            after: the id of the last record of the previous page; 0 for the first page.

        Returns:
            A map with "columns" (their names), "rows" (lists; the first value of each is the record's id) and "more"
            (whether another page follows).

        Raises:
            BadInput: if there is no such job or kind.
        """
        page: dict[str, Any] = await self.ask(wire.Records(kind, job, after))
        return page

    async def logs(self, job: str | None = None, node: int | None = None, after: int = 0) -> dict[str, Any]:
        """Return one page of the log records of the cluster's processes, oldest first; same form as `records`.

        Args:
            job: only records about the job of this id; None for all.
            node: only records of the node of this number; None for all.
            after: the id of the last record of the previous page; 0 for the first page.
        """
        page: dict[str, Any] = await self.ask(wire.Logs(job, node, after))
        return page

    async def status(self) -> dict[str, Any]:
        """Return the state of the cluster: its "nodes", the number of "jobs" in each state, "seconds" of age and more.

        See docs/protocol.md for all keys.
        """
        status: dict[str, Any] = await self.ask(wire.Status())
        return status

    @property
    def keys(self) -> Keys:
        """The key expressions of this cluster, for `listen`."""
        return self._link.keys

    def listen(self, key: str, hear: Callable[[bytes], None]) -> None:
        """Call ``hear`` on the loop with the payload of each message published under ``key``.

        The subscription lasts until the client is closed. ``hear`` must not block.
        """
        self._link.listen(key, hear)

    def listen_to_improvements(self, hear: Callable[[Improvement], None]) -> None:
        """Call ``hear`` on the loop with each verified improvement of any job, until the client is closed.

        The client decodes each one anyway, so nobody needs to subscribe and decode it again. ``hear`` must not block.
        """
        self._improvement_listeners.append(hear)

    def watch(self, key: str, hear: Callable[[str, bool], None]) -> None:
        """Call ``hear`` on the loop whenever a process appears or vanishes under ``key``.

        Processes that are there already are reported first. ``hear`` must not block.

        Args:
            key: a key expression of liveliness tokens.
            hear: called with the key of the process's token, and True if the process appeared, False if it vanished.
        """
        self._link.watch(key, hear)

    async def down(self) -> str:
        """End the cluster.

        Returns:
            "cluster" if every process ends, or "coordinator" if only the coordinator does, because router, spy and
            nodes were started separately.

        Raises:
            ClusterFailed: if no answer arrives within five seconds. The cluster may have ended all the same.
        """
        told = await self.ask(wire.Down(), _GONE_WITHIN)
        return str(told["ends"])

    async def close(self) -> None:
        """Disconnect from the cluster; its jobs go on. May be called more than once."""
        if self._closed:
            return
        self._closed = True
        for feed in list(self._feeds.values()):
            if feed.looking is not None:
                feed.looking.cancel()
            feed.wake()  # whoever waits in `more` now finds the client closed and raises
        await self._link.close()

    async def ask(self, request: wire.Request, patience: float = PATIENCE) -> Any:
        """Send a request and return the value of its answer.

        Args:
            request: the request.
            patience: seconds without any answer after which the cluster is given up.

        Raises:
            BadInput: if the cluster refuses the request because of the input.
            ClusterFailed: if the request fails in the cluster, nothing answers, or the client is closed.
        """
        if self._closed:
            raise ClusterFailed("the client is closed")
        return await self._link.ask(request, patience)

    async def look(self, feed: JobFeed, *, brief: bool = False) -> dict[str, Any]:
        """Ask for a job's current state, pass it to ``feed``, and return it.

        Args:
            feed: the job's feed.
            brief: ask only for the state and the best answer, not for the problem file, epochs and states.
        """
        view: dict[str, Any] = await self.ask(wire.Show(feed.job, brief))
        try:
            best = None if view["best"] is None else improvement_in(view["best"])
            feed.hear_view(view | {"best": best}, self._loop.time())
        except (KeyError, TypeError) as error:
            raise ClusterFailed(f"the cluster's answer cannot be read: {type(error).__name__}: {error}") from error
        return view

    async def more(self, feed: JobFeed) -> None:
        """Wait until a job's feed changes; if nothing arrives for a second, ask the cluster.

        Any number of callers may wait for the same feed; at most one question about it is under way.

        Raises:
            ClusterFailed: if the cluster has not answered for a while, or the client is closed.
        """
        if self._closed:
            raise ClusterFailed("the client is closed")
        # No await between this test and `create_task`: so no two callers can both start a question.
        left = feed.look_at - self._loop.time()
        if left <= 0 and feed.looking is None:
            feed.error = None
            feed.looking = asyncio.create_task(self._look(feed))
        await feed.news(None if feed.looking is not None else left)
        if feed.error is not None:
            raise feed.error

    async def _look(self, feed: JobFeed) -> None:
        """Run `look` in the background; an error is left in the feed, where each waiting `more` raises it."""
        try:
            await self.look(feed, brief=True)
        except (ClusterFailed, BadInput) as error:
            feed.error = error
        finally:
            feed.looking = None
            feed.wake()

    def results(self) -> "asyncio.Task[Any]":
        """Return a task that imports `supernode.runs.results`.

        The import takes a second (it loads numpy and the problems), so it runs in a thread while the loop goes on.
        """
        if self._results is None:
            self._results = asyncio.create_task(asyncio.to_thread(_imported_results))
        return self._results

    def now(self) -> float:
        """Return the loop's time, s."""
        return self._loop.time()

    def _feed(self, job: str) -> JobFeed:
        """Return the feed of a job; all handles of the same job share one.

        Raises:
            BadInput: if ``job`` cannot be the id of a job.
        """
        try:
            wire.job_id(job)
        except Rejected as error:
            raise BadInput(error.reason) from None
        feed = self._feeds.get(job)
        if feed is None:
            feed = self._feeds[job] = JobFeed(job, self._loop.time())
        return feed

    def _hear_best(self, payload: bytes) -> None:
        with contextlib.suppress(Rejected):  # anything may be published under a key: ignore what cannot be read
            better = Improvement.decode(payload)
            for feed in list(self._feeds.values()):
                feed.hear_best(better, self._loop.time())
            for hear in self._improvement_listeners:
                hear(better)

    def _hear_state(self, payload: bytes) -> None:
        with contextlib.suppress(Rejected):
            state = wire.JobState.decode(payload)
            for feed in list(self._feeds.values()):
                feed.hear_state(state, self._loop.time())


class AsyncClientJob:
    """A handle of a job on a running cluster, for asyncio.

    `AsyncClient.submit` and `AsyncClient.job` return one. Several handles of one job may exist; they share what the
    client knows of it. A handle does not keep the job running, and dropping it does not cancel the job.
    """

    def __init__(self, client: AsyncClient, feed: JobFeed) -> None:
        self._client = client
        self._feed = feed
        self._epoch = 0  # the epoch that this handle's last `update` or `rewire` made
        self._begun = 0  # the feed's count of begun epochs just before that request
        self._patient_until = 0.0  # the loop's time until which the state "waiting" may still be that of the old epoch

    @property
    def id(self) -> str:
        """The job's id, unique within the cluster."""
        return self._feed.job

    async def improvements(self) -> AsyncIterator[Improvement]:
        """Yield each verified improvement as it arrives, first those that are known already; end when the job ends.

        The client keeps the newest thousand improvements of a job. A reader that falls further behind misses the older
        ones.

        Raises:
            ClusterFailed: if the cluster has not answered for a while.
        """
        better = None
        while (better := await self.improvement(better)) is not None:
            yield better

    async def improvement(self, after: Improvement | None) -> Improvement | None:
        """Return the improvement that follows ``after`` (None: the first) once it is known; None if the job ends."""
        feed = self._feed
        while (better := feed.after(after)) is None and feed.end is None:
            await self._client.more(feed)
        return better

    async def event(self, after: Improvement | None, state: str | None) -> Improvement | str | None:
        """Return the next improvement or a new state of the job, once there is one; None when the job ends.

        Args:
            after: the last improvement that the caller has seen; None for none.
            state: the last state that the caller has seen; None for none.

        Returns:
            The improvement that follows ``after``, or the job's state if it is not ``state``. Improvements come first.
            The states in which a job ends are not returned.
        """
        feed = self._feed
        while (better := feed.after(after)) is None and feed.end is None:
            if feed.status is not None and feed.status != state and feed.status not in ENDS:
                return feed.status
            await self._client.more(feed)
        return better

    async def answer(self, timeout: float | None = None) -> Improvement | None:
        """Return the best feasible solution, once the job cannot improve it or ``timeout`` is over.

        It returns when the job has ended, when a job that is kept alive waits for an update, or after ``timeout``.
        A job that is kept alive waits once it is solved or, if its problem has no target, once it has stalled with a
        feasible answer. A job that still searches therefore uses the whole ``timeout``.

        Args:
            timeout: seconds; None waits without limit.

        Returns:
            The best improvement that the planner's check accepts, in the epoch of this handle's last `update` or
            `rewire` or later; None if there is none yet.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while not self._is_answered():
                    await self._client.more(self._feed)
        return self._feed.answer(self._epoch)

    async def result(self, timeout: float | None = None) -> "Result":
        """Wait until the job has ended and return its result.

        If the cluster or the problem broke, the result's `status` is "failed" and its `message` says why.

        Args:
            timeout: seconds; None waits without limit.

        Raises:
            TimeoutError: if the job has not ended by then.
            ClusterFailed: if the cluster has not answered for a while.
        """
        results = self._client.results()  # importing goes on while the job runs
        view = await self._wait_until_over(timeout)
        if view["result"] is None:
            view = await self.show()
        # Shielded: the import is shared by all jobs of the client, so cancelling one waiter must not cancel it.
        result: Result = (await asyncio.shield(results)).result_in(view)
        return result

    async def end(self, timeout: float | None = None) -> Mapping[str, Any]:
        """Wait until the job has ended and return all that the cluster knows of it; see `show`.

        Args:
            timeout: seconds; None waits without limit.

        Raises:
            TimeoutError: if the job has not ended by then.
        """
        await self._wait_until_over(timeout)
        return await self.show()

    async def _wait_until_over(self, timeout: float | None) -> Mapping[str, Any]:
        try:
            async with asyncio.timeout(timeout):
                while self._feed.end is None:
                    await self._client.more(self._feed)
        except TimeoutError:
            raise TimeoutError(f"job {self.id} has not ended within {timeout} s") from None
        return self._feed.end

    async def show(self) -> dict[str, Any]:
        """Return all that the cluster knows of the job now, as plain values.

        The keys, such as "status", "best", "result", "epochs" and "file", are described in docs/protocol.md.
        """
        return await self._client.look(self._feed)

    async def state(self) -> str:
        """Return the job's state now, such as "queued", "running" or "solved"."""
        return str((await self.show())["status"])

    async def cancel(self) -> str:
        """End the job; its result is the best found so far.

        Returns:
            The job's state before it was cancelled. A job that has ended already is left as it is.
        """
        told = await self._client.ask(wire.Cancel(self.id))
        return str(told["status"])

    async def update(self, patch: Mapping[str, Any] | str | Path | None = None, /, **keys: Any) -> int:
        """Change the problem while the job runs: each top-level key replaces the problem's own.

        The job goes on in a new epoch, from the individuals that it has. An update that changes nothing makes no new
        epoch.

        Args:
            patch: keys and values, with angles in radians; or the path of a TOML file that holds them. Files that such
                a file names (a map, a mesh) are read relative to it. Its angles are in its own `unit` or, if it has
                none, in the unit of the problem file.
            keys: more keys and values, such as ``goal=[3.0, 4.0]``; they win over ``patch``.

        Returns:
            The number of the epoch that has the change.

        Raises:
            BadInput: if the changed problem would be wrong. The message names the key and the patch's file, if there is
                one. The job goes on unchanged.
        """
        path = patch if isinstance(patch, str | Path) else None
        if isinstance(patch, str | Path):
            patch = await self._read(patch)
        try:
            text = json.dumps({**(patch or {}), **keys}, default=str, allow_nan=False)
        except ValueError as error:
            raise BadInput(f"update: expected plain values, found {error}") from None
        try:
            return await self._new_epoch(wire.Update(self.id, text))
        except BadInput as error:
            if path is None or not str(error).startswith(UPDATE_OF):  # not the patch's fault: the job has ended, say
                raise
            raise BadInput(f"{path}: {error}") from None

    async def _read(self, path: str | Path) -> dict[str, Any]:
        """Read a patch file as a patch of this job's current problem.

        The file alone does not say of which kind the problem is and in which unit its angles are; the job knows both.
        """
        patch = await asyncio.to_thread(load_patch, path)
        now = ProblemFile.from_json((await self.show())["file_now"])
        return await asyncio.to_thread(filled_in, patch, now, path)

    async def rewire(self, topology: str) -> int:
        """Give the running job another topology of as many cells.

        Args:
            topology: such as ``"ring 16"`` or ``"torus 2x8"``; see docs/topologies.md.

        Returns:
            The number of the epoch from which on the job has it.

        Raises:
            BadInput: if there is no such topology, or it does not have as many cells as the job.
        """
        return await self._new_epoch(wire.Rewire(self.id, topology))

    async def _new_epoch(self, request: wire.Update | wire.Rewire) -> int:
        self._begun = self._feed.begun
        told = await self._client.ask(request)
        self._epoch = int(told["epoch"])
        self._patient_until = self._client.now() + _BEGUN_WITHIN
        return self._epoch

    def _is_answered(self) -> bool:
        """Return whether the job has ended, or waits with its answer to the last update.

        Right after an update the feed may still hold the "waiting" of the epoch before. So "waiting" counts only once
        the new epoch is known to have begun, or enough time has passed for a message that says so to have been lost.
        """
        feed = self._feed
        if feed.status != WAITING:
            return feed.answered
        begun = feed.begun > self._begun or feed.best(self._epoch) is not None
        return self._epoch == 0 or begun or self._client.now() >= self._patient_until


class Client:
    """A blocking client of a running cluster; a context manager.

    `supernode.connect` makes one. Its methods, and those of its jobs, may be called from any thread.
    """

    def __init__(self, place: Place) -> None:
        self._thread = _LoopThread()
        try:
            self._client = self._thread.run(AsyncClient.open(place))
        except BaseException:
            self._thread.stop()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def submit(
        self, file: ProblemFile | str | Path, *, id: str | None = None, priority: int = 0, **run: Any
    ) -> "ClientJob":
        """Submit a job and return a handle of it once the cluster has stored it.

        Args:
            file: a problem file from `supernode.load`, or the path of one.
            id: an id of your choice: 1 to 64 letters, digits, dots, hyphens and underscores. To submit the same problem
                again under the same id is safe: it is the same job. None picks a random id.
            priority: jobs of a higher priority leave the queue first; at most a million in either direction.
            run: settings that replace those of the file's ``[run]`` table, such as ``seed=1`` or ``seconds=5``.

        Raises:
            BadInput: if the file, a setting or the id is wrong, or if the cluster refuses the job.
            ClusterFailed: if the cluster does not answer.
        """
        return ClientJob(self._thread, self._thread.run(self._client.submit(file, id=id, priority=priority, **run)))

    def jobs(self, limit: int | None = None) -> list[dict[str, Any]]:
        """Return a summary of each job (the newest ``limit``, or all), newest last; see `AsyncClient.jobs`."""
        return self._thread.run(self._client.jobs(limit))

    def records(self, kind: str, job: str, after: int = 0) -> dict[str, Any]:
        """Return one page of the records of a job, oldest first; see `AsyncClient.records`."""
        return self._thread.run(self._client.records(kind, job, after))

    def logs(self, job: str | None = None, node: int | None = None, after: int = 0) -> dict[str, Any]:
        """Return one page of the log records of the cluster's processes; see `AsyncClient.logs`."""
        return self._thread.run(self._client.logs(job, node, after))

    def job(self, id: str) -> "ClientJob":
        """Return a handle of a job that was submitted before, by this or another client.

        Raises:
            BadInput: if the cluster knows no job of that id.
        """
        return ClientJob(self._thread, self._thread.run(self._client.job(id)))

    def status(self) -> dict[str, Any]:
        """Return the state of the cluster, such as its "nodes" and how many "jobs" are in each state."""
        return self._thread.run(self._client.status())

    @property
    def keys(self) -> Keys:
        """The key expressions of this cluster, for `listen`."""
        return self._client.keys

    def listen(self, key: str, hear: Callable[[bytes], None]) -> None:
        """Call ``hear`` on the client's thread with the payload of each message published under ``key``.

        ``hear`` must not block. It must not call methods of this client or its jobs either: they would wait for the
        very thread that calls ``hear``.
        """
        self._client.listen(key, hear)

    def down(self) -> str:
        """End the cluster; see `AsyncClient.down`."""
        return self._thread.run(self._client.down())

    def close(self) -> None:
        """Disconnect from the cluster; its jobs go on. May be called more than once."""
        if self._thread.runs:
            self._thread.run(self._client.close())
            self._thread.stop()


class ClientJob:
    """A handle of a job on a running cluster; `Client.submit` and `Client.job` return one.

    It may be used from any thread. Dropping it does not cancel the job.
    """

    def __init__(self, thread: "_LoopThread", job: AsyncClientJob) -> None:
        self._thread = thread
        self._job = job

    @property
    def id(self) -> str:
        """The job's id, unique within the cluster."""
        return self._job.id

    def improvements(self) -> Iterator[Improvement]:
        """Yield each verified improvement as it arrives, first those that are known already; end when the job ends.

        A reader that falls more than a thousand improvements behind misses the older ones.

        Raises:
            ClusterFailed: if the cluster has not answered for a while.
        """
        better = None
        while (better := self._thread.run(self._job.improvement(better))) is not None:
            yield better

    def answer(self, timeout: float | None = None) -> Improvement | None:
        """Return the best feasible solution, once the job cannot improve it or ``timeout`` is over.

        It returns when the job has ended, when a job that is kept alive waits for an update, or after ``timeout``
        seconds (None: no limit). A job that still searches uses the whole ``timeout``.

        Returns:
            The best improvement that the planner's check accepts since this handle's last `update` or `rewire`; None if
            there is none yet.
        """
        return self._thread.run(self._job.answer(timeout))

    def events(self) -> Iterator[Improvement | str]:
        """Yield what `improvements` yields and, between them, each state that the job reaches before it ends."""
        better, state = None, None
        while (event := self._thread.run(self._job.event(better, state))) is not None:
            if isinstance(event, str):
                state = event
            else:
                better = event
            yield event

    def result(self, timeout: float | None = None) -> "Result":
        """Wait until the job has ended and return its result.

        If the cluster or the problem broke, the result's `status` is "failed" and its `message` says why.

        Args:
            timeout: seconds; None waits without limit.

        Raises:
            TimeoutError: if the job has not ended by then.
            ClusterFailed: if the cluster has not answered for a while.
        """
        return self._thread.run(self._job.result(timeout))

    def end(self, timeout: float | None = None) -> Mapping[str, Any]:
        """Wait until the job has ended and return all that the cluster knows of it; see `AsyncClientJob.end`."""
        return self._thread.run(self._job.end(timeout))

    def show(self) -> dict[str, Any]:
        """Return all that the cluster knows of the job now, as plain values; see docs/protocol.md for the keys."""
        return self._thread.run(self._job.show())

    def state(self) -> str:
        """Return the job's state now, such as "queued", "running" or "solved"."""
        return self._thread.run(self._job.state())

    def cancel(self) -> str:
        """End the job, with the best found so far as its result, and return the state that it was in."""
        return self._thread.run(self._job.cancel())

    def update(self, patch: Mapping[str, Any] | str | Path | None = None, /, **keys: Any) -> int:
        """Change the problem while the job runs: each top-level key replaces the problem's own.

        The job goes on in a new epoch, from the individuals that it has. See `AsyncClientJob.update` for what a file of
        a patch may hold.

        Args:
            patch: keys and values, with angles in radians; or the path of a TOML file that holds them.
            keys: more keys and values, such as ``goal=[3.0, 4.0]``; they win over ``patch``.

        Returns:
            The number of the epoch that has the change.

        Raises:
            BadInput: if the changed problem would be wrong; the job goes on unchanged.
        """
        return self._thread.run(self._job.update(patch, **keys))

    def rewire(self, topology: str) -> int:
        """Give the running job another topology of as many cells, such as ``"ring 16"``.

        Returns:
            The number of the epoch from which on the job has it.

        Raises:
            BadInput: if there is no such topology, or it does not have as many cells as the job.
        """
        return self._thread.run(self._job.rewire(topology))


class _LoopThread:
    """An asyncio loop in a daemon thread, on which blocking callers run coroutines."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="supernode client", daemon=True)
        self._thread.start()
        self.runs = True

    def run(self, work: Coroutine[Any, Any, _Value]) -> _Value:
        """Run ``work`` on the loop and return its value; if the caller is interrupted, cancel it.

        Called on the loop's own thread it would wait for itself for ever.
        """
        if not self.runs:
            # A coroutine that is neither awaited nor closed would cause a warning.
            work.close()
            raise ClusterFailed("the client is closed")
        # Ctrl-C interrupts the caller's wait, not the loop: the coroutine must be cancelled by hand.
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def stop(self) -> None:
        """End the thread and the worker threads of its loop."""
        asyncio.run_coroutine_threadsafe(self._loop.shutdown_default_executor(), self._loop).result()
        self.runs = False
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
