"""The blocking client of a running cluster, and handles of jobs.

::

    with supernode.connect() as client:
        job = client.submit("examples/arm-ik.toml", seed=1, seconds=5)
        for best in job.improvements():
            print(best.fitness, best.feasible, best.solution)
        result = job.result()

`AsyncClient` is the implementation; it runs on the asyncio loop of its caller. `Client` wraps an `AsyncClient` that
runs on a loop of its own, in a background thread, so both behave the same.
"""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from problems import Problem, ProblemFile
from supernode.client.async_client import AsyncClient
from supernode.client.async_job import AsyncClientJob
from supernode.client.cluster_info import Place
from supernode.client.loop_thread import LoopThread
from wire.keys import Keys
from wire.news import Improvement

if TYPE_CHECKING:
    from spy.result import Result


class ClientJob:
    """A handle of a job on a running cluster; `Client.submit` and `Client.job` return one.

    It may be used from any thread. Dropping it does not cancel the job.
    """

    def __init__(self, thread: LoopThread, job: AsyncClientJob) -> None:
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


class Client:
    """A blocking client of a running cluster; a context manager.

    `supernode.connect` makes one. Its methods, and those of its jobs, may be called from any thread.
    """

    def __init__(self, place: Place) -> None:
        self._thread = LoopThread()
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
        self, file: ProblemFile | Problem | str | Path, *, id: str | None = None, priority: int = 0, **run: Any
    ) -> ClientJob:
        """Submit a job and return a handle of it once the cluster has stored it.

        Args:
            file: a problem file from `supernode.load`, the path of one, or a problem made in Python.
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

    def job(self, id: str) -> ClientJob:
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


def connect(endpoint_or_state: str | Path | None = None, keys: str | Path | None = None) -> Client:
    """Connect to a running cluster and return a blocking client.

    Args:
        endpoint_or_state: an endpoint such as ``"tcp/127.0.0.1:7447"``, or the state folder of a `supernode up` on this
            machine. None means the user's default state folder.
        keys: the folder with the keys of a client, for an endpoint such as ``"tls/10.0.0.2:7447"``.

    Returns:
        A client; use it as a context manager, or call its `close`.

    Raises:
        ClusterFailed: if no cluster is found there within two seconds, or if the cluster does not answer.
    """
    return Client(Place.of(endpoint_or_state, keys))
