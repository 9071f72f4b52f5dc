"""Clients of a running cluster, blocking and asyncio.

::

    with supernode.connect() as client:
        job = client.submit("examples/arm-ik.toml", seed=1, seconds=5)
        for best in job.improvements():
            print(best.fitness, best.feasible, best.solution)
        result = job.result()

There is one implementation, `AsyncClient`, which lives on an asyncio loop; `Client` is the same on a loop of its own,
in a thread.
"""

import asyncio
import contextlib
import json
import secrets
import threading
import weakref
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self, TypeVar

from coordinator.errors import ClusterFailed
from coordinator.states import ENDS
from problems import ProblemFile, load
from problems.errors import UPDATE_OF, BadInput
from problems.file import filled_in, load_patch
from supernode.cluster_info import Place
from supernode.job_feed import WAITING, JobFeed, improvement_in
from supernode.link import PATIENCE, Link
from wire import jobs as wire
from wire.keys import Keys
from wire.news import Improvement
from wire.strict import Rejected

if TYPE_CHECKING:
    from spy.result import Result

_Value = TypeVar("_Value")
_GONE_WITHIN = 5.0  # seconds: who is asked to end may do so before its answer has left
_BEGUN_WITHIN = 2.0  # seconds: a new epoch of a job has begun, or nothing was heard of it


def connect(endpoint_or_state: str | Path | None = None) -> "Client":
    """Connect to a running cluster.

    Args:
        endpoint_or_state: an endpoint such as ``"tcp/127.0.0.1:7447"``, or the state folder of `supernode up` on this
            machine; by default the user's own.

    Raises:
        ClusterFailed: if no cluster is there, within two seconds, or it does not answer.
    """
    return Client(Place.of(endpoint_or_state))


async def connect_async(endpoint_or_state: str | Path | None = None) -> "AsyncClient":
    """The same for asyncio."""
    return await AsyncClient.open(Place.of(endpoint_or_state))


class AsyncClient:
    """A running cluster, as a program that uses asyncio sees it; an async context manager."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._loop = asyncio.get_running_loop()
        self._feeds: weakref.WeakValueDictionary[str, JobFeed] = weakref.WeakValueDictionary()
        self._closed = False
        self._results: asyncio.Task[Any] | None = None
        link.listen(link.keys.best, self._hear_best)
        link.listen(link.keys.state, self._hear_state)

    @classmethod
    async def open(cls, place: Place) -> Self:
        """Connect to a cluster; see `connect_async`."""
        return cls(await Link.open(place))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def submit(
        self, file: ProblemFile | str | Path, *, id: str | None = None, priority: int = 0, **run: Any
    ) -> "AsyncClientJob":
        """Hand in a job.

        Args:
            file: from `supernode.load`, or the path of a problem file.
            id: of your choice; the same problem submitted again under the same id is the same job.
            priority: a job of a higher one is taken from the queue earlier.
            run: settings that replace those of the file's ``[run]`` table, such as ``seed=1``, ``seconds=5``.

        Raises:
            BadInput: if the file, a setting or the id is wrong, or the cluster refuses the job.
            ClusterFailed: if nobody answers.
        """
        loaded = file if isinstance(file, ProblemFile) else await asyncio.to_thread(load, file)
        asked = loaded.with_run(**run)
        asked.refuse_unreachable()
        text = asked.to_json()
        feed = self._feed(secrets.token_hex(4) if id is None else id)  # it listens from now on
        await self.ask(wire.Submit(text, feed.job, priority))
        return AsyncClientJob(self, feed)

    async def jobs(self, limit: int | None = None) -> list[dict[str, Any]]:
        """What there is to know of each job in a few words, the newest last."""
        listed: list[dict[str, Any]] = await self.ask(wire.ListJobs(limit))
        return listed

    async def job(self, id: str) -> "AsyncClientJob":
        """A job that was submitted before, by whomever.

        Raises:
            BadInput: if there is no such job.
        """
        feed = self._feed(id)
        await self.look(feed)
        return AsyncClientJob(self, feed)

    async def records(self, kind: str, job: str, after: int = 0) -> dict[str, Any]:
        """What happened in a job, a page of it.

        Args:
            kind: "improvements" as they were heard, without their solutions; "history", the improvements of epochs that
                have ended, as their cells noted them: a function of the run; or "statistics", one for each second.
            job: its id.
            after: the id of the last record of the page before.

        Returns:
            "columns", "rows" (the first of each row is its id), and whether there are "more".
        """
        page: dict[str, Any] = await self.ask(wire.Records(kind, job, after))
        return page

    async def logs(self, job: str | None = None, node: int | None = None, after: int = 0) -> dict[str, Any]:
        """What the processes had to say, a page of it as in `records`: all, or that of a job or of a node."""
        page: dict[str, Any] = await self.ask(wire.Logs(job, node, after))
        return page

    async def status(self) -> dict[str, Any]:
        """The cluster: its nodes, and how many jobs there are in each state."""
        status: dict[str, Any] = await self.ask(wire.Status())
        return status

    @property
    def keys(self) -> Keys:
        """The cluster's key expressions."""
        return self._link.keys

    def listen(self, key: str, hear: Callable[[bytes], None]) -> None:
        """Have the loop call ``hear`` with each message that is published under ``key``."""
        self._link.listen(key, hear)

    def watch(self, key: str, hear: Callable[[str, bool], None]) -> None:
        """Have the loop call ``hear`` with each process's token under ``key`` as it comes (True) and goes (False)."""
        self._link.watch(key, hear)

    async def down(self) -> str:
        """End the whole "cluster", or only the "coordinator" if router, spy and nodes were started each by itself.

        Returns:
            which of the two.
        """
        told = await self.ask(wire.Down(), _GONE_WITHIN)
        return str(told["ends"])

    async def close(self) -> None:
        """Leave the cluster; jobs go on. Idempotent."""
        if self._closed:
            return
        self._closed = True
        for feed in list(self._feeds.values()):
            if feed.looking is not None:
                feed.looking.cancel()
            feed.wake()
        await self._link.close()

    async def ask(self, request: wire.Request, patience: float = PATIENCE) -> Any:
        """The value that a request is answered with.

        Args:
            request: what to ask.
            patience: seconds without any answer, after which the cluster is given up.

        Raises:
            BadInput: if it is refused and the input is to blame.
            ClusterFailed: if it fails.
        """
        if self._closed:
            raise ClusterFailed("the client is closed")
        return await self._link.ask(request, patience)

    async def look(self, feed: JobFeed, *, brief: bool = False) -> dict[str, Any]:
        """Ask for all there is to know of a job, or in ``brief`` for how it is and its answer."""
        view: dict[str, Any] = await self.ask(wire.Show(feed.job, brief))
        try:
            best = None if view["best"] is None else improvement_in(view["best"])
            feed.hear_view(view | {"best": best}, self._loop.time())
        except (KeyError, TypeError) as error:
            raise ClusterFailed(f"the cluster's answer cannot be read: {type(error).__name__}: {error}") from error
        return view

    async def more(self, feed: JobFeed) -> None:
        """Wait until more is known of a job; without news for a second, ask.

        Raises:
            ClusterFailed: if nobody has answered for a while, or the client is closed.
        """
        if self._closed:
            raise ClusterFailed("the client is closed")
        left = feed.look_at - self._loop.time()
        if left <= 0 and feed.looking is None:
            feed.error = None
            feed.looking = asyncio.create_task(self._look(feed))
        await feed.news(None if feed.looking is not None else left)
        if feed.error is not None:
            raise feed.error

    async def _look(self, feed: JobFeed) -> None:
        """The same as `look`, beside whatever else comes; a failure is left for those who wait."""
        try:
            await self.look(feed, brief=True)
        except (ClusterFailed, BadInput) as error:
            feed.error = error
        finally:
            feed.looking = None
            feed.wake()

    def results(self) -> "asyncio.Task[Any]":
        """The module that reads results: importing it takes a second, in which the loop has other things to do."""
        if self._results is None:
            self._results = asyncio.create_task(asyncio.to_thread(import_module, "supernode.results"))
        return self._results

    def now(self) -> float:
        """The loop's time."""
        return self._loop.time()

    def _feed(self, job: str) -> JobFeed:
        """All handles of a job share one."""
        try:
            wire.job_id(job)
        except Rejected as error:
            raise BadInput(error.reason) from None
        feed = self._feeds.get(job)
        if feed is None:
            feed = self._feeds[job] = JobFeed(job, self._loop.time())
        return feed

    def _hear_best(self, payload: bytes) -> None:
        with contextlib.suppress(Rejected):
            better = Improvement.decode(payload)
            for feed in list(self._feeds.values()):
                feed.hear_best(better, self._loop.time())

    def _hear_state(self, payload: bytes) -> None:
        with contextlib.suppress(Rejected):
            state = wire.JobState.decode(payload)
            for feed in list(self._feeds.values()):
                feed.hear_state(state, self._loop.time())


class AsyncClientJob:
    """A job on a running cluster."""

    def __init__(self, client: AsyncClient, feed: JobFeed) -> None:
        self._client = client
        self._feed = feed
        self._epoch = 0  # that the last update made
        self._begun = 0  # how often an epoch had begun before that
        self._patient_until = 0.0  # the loop's time from which on a state is believed to be of that epoch

    @property
    def id(self) -> str:
        """Its id."""
        return self._feed.job

    async def improvements(self) -> AsyncIterator[Improvement]:
        """Each verified improvement as it comes, those known before first; ends with the job.

        Whoever falls more than a thousand behind misses those before.

        Raises:
            ClusterFailed: if the cluster has not answered for a while.
        """
        better = None
        while (better := await self.improvement(better)) is not None:
            yield better

    async def improvement(self, after: Improvement | None) -> Improvement | None:
        """The first improvement, or the next one, when it has come; None if the job ends before."""
        feed = self._feed
        while (better := feed.after(after)) is None and feed.end is None:
            await self._client.more(feed)
        return better

    async def event(self, after: Improvement | None, state: str | None) -> Improvement | str | None:
        """The first improvement, or the next one; or the job's state, if it is another than this one; None at its end.

        An end is no such state.
        """
        feed = self._feed
        while (better := feed.after(after)) is None and feed.end is None:
            if feed.status is not None and feed.status != state and feed.status not in ENDS:
                return feed.status
            await self._client.more(feed)
        return better

    async def answer(self, timeout: float | None = None) -> Improvement | None:
        """The best feasible answer when the job has ended, waits for an update, or so many seconds have gone by.

        A job that is kept alive waits once it is solved, or has a feasible answer if its problem has no target; until
        then it searches. None if nothing feasible is known by then, in the epoch that the last `update` made.
        """
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout):
                while not self._is_answered():
                    await self._client.more(self._feed)
        return self._feed.answer(self._epoch)

    async def result(self, timeout: float | None = None) -> "Result":
        """Wait for the end. If the cluster or the problem broke, the result's status is "failed" and it says why.

        Args:
            timeout: seconds.

        Raises:
            TimeoutError: if the job has not ended by then.
            ClusterFailed: if the cluster has not answered for a while.
        """
        results = self._client.results()  # meanwhile
        view = await self._over(timeout)
        if view["result"] is None:
            view = await self.show()
        result: Result = (await asyncio.shield(results)).result_in(view)
        return result

    async def end(self, timeout: float | None = None) -> Mapping[str, Any]:
        """Wait for the end; all that the cluster knows of the job then, see `show`."""
        await self._over(timeout)
        return await self.show()

    async def _over(self, timeout: float | None) -> Mapping[str, Any]:
        try:
            async with asyncio.timeout(timeout):
                while self._feed.end is None:
                    await self._client.more(self._feed)
        except TimeoutError:
            raise TimeoutError(f"job {self.id} has not ended within {timeout} s") from None
        return self._feed.end

    async def show(self) -> dict[str, Any]:
        """All that the cluster knows of the job now, in plain values."""
        return await self._client.look(self._feed)

    async def state(self) -> str:
        """The job's state now, such as "queued" or "solved"."""
        return str((await self.show())["status"])

    async def cancel(self) -> str:
        """End the job; its result is the best so far. Its state when it was told so."""
        told = await self._client.ask(wire.Cancel(self.id))
        return str(told["status"])

    async def update(self, patch: Mapping[str, Any] | str | Path | None = None, /, **keys: Any) -> int:
        """The world has moved: each top-level key replaces the problem's own, and the job goes on from what it has.

        Args:
            patch: keys and values, with angles in radians, or the path of a file that holds them. What that file names
                is read beside it, as with a problem file, and its angles are in its own `unit`, else in that of the
                problem file.
            keys: likewise.

        Returns:
            the number of the new epoch.

        Raises:
            BadInput: names the file of the patch, if there is one, and the key with which the problem is wrong; the job
                goes on with the old world.
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
            if path is None or not str(error).startswith(UPDATE_OF):  # such as a job that has ended
                raise
            raise BadInput(f"{path}: {error}") from None

    async def _read(self, path: str | Path) -> dict[str, Any]:
        """A patch in a file. It does not say which problem it changes: the job does."""
        patch = await asyncio.to_thread(load_patch, path)
        now = ProblemFile.from_json((await self.show())["file_now"])
        return await asyncio.to_thread(filled_in, patch, now, path)

    async def rewire(self, topology: str) -> int:
        """Give the running job another topology.

        Returns:
            the number of the epoch from which on it has it.

        Raises:
            BadInput: if there is no such topology, or it is too large for the cluster.
        """
        return await self._new_epoch(wire.Rewire(self.id, topology))

    async def _new_epoch(self, request: wire.Update | wire.Rewire) -> int:
        self._begun = self._feed.begun
        told = await self._client.ask(request)
        self._epoch = int(told["epoch"])
        self._patient_until = self._client.now() + _BEGUN_WITHIN
        return self._epoch

    def _is_answered(self) -> bool:
        """Whether the job has ended, or waits in the epoch that the last update made, not still in the one before."""
        feed = self._feed
        if feed.status != WAITING:
            return feed.answered
        begun = feed.begun > self._begun or feed.best(self._epoch) is not None
        return self._epoch == 0 or begun or self._client.now() >= self._patient_until


class Client:
    """A running cluster; a context manager. Its methods may be called from any thread; see `AsyncClient` for them."""

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
        """Hand in a job, see `AsyncClient.submit`."""
        return ClientJob(self._thread, self._thread.run(self._client.submit(file, id=id, priority=priority, **run)))

    def jobs(self, limit: int | None = None) -> list[dict[str, Any]]:
        """What there is to know of each job in a few words, the newest last."""
        return self._thread.run(self._client.jobs(limit))

    def records(self, kind: str, job: str, after: int = 0) -> dict[str, Any]:
        """What happened in a job, see `AsyncClient.records`."""
        return self._thread.run(self._client.records(kind, job, after))

    def logs(self, job: str | None = None, node: int | None = None, after: int = 0) -> dict[str, Any]:
        """What the processes had to say, see `AsyncClient.logs`."""
        return self._thread.run(self._client.logs(job, node, after))

    def job(self, id: str) -> "ClientJob":
        """A job that was submitted before, see `AsyncClient.job`."""
        return ClientJob(self._thread, self._thread.run(self._client.job(id)))

    def status(self) -> dict[str, Any]:
        """The cluster: its nodes, and how many jobs there are in each state."""
        return self._thread.run(self._client.status())

    @property
    def keys(self) -> Keys:
        """The cluster's key expressions."""
        return self._client.keys

    def listen(self, key: str, hear: Callable[[bytes], None]) -> None:
        """Have a thread of the client's call ``hear`` with each message that is published under ``key``."""
        self._client.listen(key, hear)

    def down(self) -> str:
        """End the cluster, see `AsyncClient.down`."""
        return self._thread.run(self._client.down())

    def close(self) -> None:
        """Leave the cluster; jobs go on. Idempotent."""
        if self._thread.runs:
            self._thread.run(self._client.close())
            self._thread.stop()


class ClientJob:
    """A job on a running cluster; see `AsyncClientJob` for its methods."""

    def __init__(self, thread: "_LoopThread", job: AsyncClientJob) -> None:
        self._thread = thread
        self._job = job

    @property
    def id(self) -> str:
        """Its id."""
        return self._job.id

    def improvements(self) -> Iterator[Improvement]:
        """Each verified improvement as it comes, those known before first; ends with the job."""
        better = None
        while (better := self._thread.run(self._job.improvement(better))) is not None:
            yield better

    def answer(self, timeout: float | None = None) -> Improvement | None:
        """The best feasible answer within so many seconds, see `AsyncClientJob.answer`."""
        return self._thread.run(self._job.answer(timeout))

    def events(self) -> Iterator[Improvement | str]:
        """The same as `improvements`, and the states that the job comes to meanwhile."""
        better, state = None, None
        while (event := self._thread.run(self._job.event(better, state))) is not None:
            if isinstance(event, str):
                state = event
            else:
                better = event
            yield event

    def result(self, timeout: float | None = None) -> "Result":
        """Wait for the end, see `AsyncClientJob.result`."""
        return self._thread.run(self._job.result(timeout))

    def end(self, timeout: float | None = None) -> Mapping[str, Any]:
        """Wait for the end; all that the cluster knows of the job then, see `show`."""
        return self._thread.run(self._job.end(timeout))

    def show(self) -> dict[str, Any]:
        """All that the cluster knows of the job now, in plain values."""
        return self._thread.run(self._job.show())

    def state(self) -> str:
        """The job's state now, such as "queued" or "solved"."""
        return self._thread.run(self._job.state())

    def cancel(self) -> str:
        """End the job; its result is the best so far. Its state when it was told so."""
        return self._thread.run(self._job.cancel())

    def update(self, patch: Mapping[str, Any] | str | Path | None = None, /, **keys: Any) -> int:
        """The world has moved, see `AsyncClientJob.update`."""
        return self._thread.run(self._job.update(patch, **keys))

    def rewire(self, topology: str) -> int:
        """Give the running job another topology, see `AsyncClientJob.rewire`."""
        return self._thread.run(self._job.rewire(topology))


class _LoopThread:
    """An asyncio loop in a thread, for callers that block."""

    def __init__(self) -> None:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="supernode client", daemon=True)
        self._thread.start()
        self.runs = True

    def run(self, work: Coroutine[Any, Any, _Value]) -> _Value:
        """What comes of ``work``; it is given up if the caller is interrupted."""
        if not self.runs:
            work.close()
            raise ClusterFailed("the client is closed")
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result()
        except BaseException:
            future.cancel()
            raise

    def stop(self) -> None:
        """End the thread, and those that it had work in."""
        asyncio.run_coroutine_threadsafe(self._loop.shutdown_default_executor(), self._loop).result()
        self.runs = False
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
