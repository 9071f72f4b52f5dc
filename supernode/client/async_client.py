"""The client of a running cluster for programs that use asyncio; `supernode.client.client` is made of it."""

import asyncio
import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from problems import Problem, ProblemFile
from problems.in_memory import file_of
from supernode.client.async_job import AsyncClientJob
from supernode.client.cluster_info import Place
from supernode.client.job_tracker import JobTracker
from supernode.client.link import PATIENCE, Link
from wire import jobs as wire
from wire.keys import Keys
from wire.news import Improvement

_GONE_WITHIN = 5.0  # seconds to wait for an answer to `down`: the coordinator may exit before its answer has left


class AsyncClient:
    """A client of a running cluster for programs that use asyncio; an async context manager.

    `supernode.connect_async` makes one. Use it, and the jobs that it returns, only on the loop that it was made on.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._tracker = JobTracker(link)

    @classmethod
    async def open(cls, place: Place) -> Self:
        """Connect to the cluster at ``place``; see `connect_async`."""
        return cls(await Link.open(place))

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.close()

    async def submit(
        self, file: ProblemFile | Problem | str | Path, *, id: str | None = None, priority: int = 0, **run: Any
    ) -> AsyncClientJob:
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
        # In a thread: loading may read large files and import a user's module, which would block the loop.
        loaded = file if isinstance(file, ProblemFile) else await asyncio.to_thread(file_of, file)
        asked = loaded.with_run(**run)
        asked.refuse_unreachable()
        text = asked.to_json()
        # The feed exists before the request is sent, so improvements that overtake the answer are not lost.
        feed = self._tracker.feed(secrets.token_hex(4) if id is None else id)
        await self.ask(wire.Submit(text, feed.job, priority))
        return AsyncClientJob(self._tracker, feed)

    async def jobs(self, limit: int | None = None) -> list[dict[str, Any]]:
        """Return a summary of each job the cluster knows, newest last.

        Args:
            limit: return only the newest ``limit`` jobs; None returns all that fit into one answer.

        Returns:
            One map for each job, with its "job" (id), "status", "kind", "fitness" and more; see docs/protocol.md.
        """
        listed: list[dict[str, Any]] = await self.ask(wire.ListJobs(limit))
        return listed

    async def job(self, id: str) -> AsyncClientJob:
        """Return a handle of a job that was submitted before, by this or another client.

        Raises:
            BadInput: if the cluster knows no job of that id.
        """
        feed = self._tracker.feed(id)
        await self._tracker.look(feed)
        return AsyncClientJob(self._tracker, feed)

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
        self._tracker.listen_to_improvements(hear)

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
        await self._tracker.close()

    async def ask(self, request: wire.Request, patience: float = PATIENCE) -> Any:
        """Send a request and return the value of its answer.

        Args:
            request: the request.
            patience: seconds without any answer after which the cluster is given up.

        Raises:
            BadInput: if the cluster refuses the request because of the input.
            ClusterFailed: if the request fails in the cluster, nothing answers, or the client is closed.
        """
        return await self._tracker.ask(request, patience)


async def connect_async(endpoint_or_state: str | Path | None = None, keys: str | Path | None = None) -> AsyncClient:
    """Connect to a running cluster and return a client for asyncio.

    Arguments and errors are those of `connect`.
    """
    return await AsyncClient.open(Place.of(endpoint_or_state, keys))
