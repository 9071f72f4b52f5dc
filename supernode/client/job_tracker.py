"""Keep a feed of each job that a client has handles of, from messages or, while none arrive, by asking the cluster.

Only the loop touches the state of a client and its jobs. Zenoh delivers messages on threads of its own; `Link` hands
them to the loop. Therefore nothing here needs a lock.
"""

import asyncio
import contextlib
import weakref
from collections.abc import Callable
from types import ModuleType
from typing import Any

from coordinator.errors import ClusterFailed
from problems.errors import BadInput
from supernode.client.job_feed import JobFeed, improvement_in
from supernode.client.link import PATIENCE, Link
from wire import jobs as wire
from wire.news import Improvement
from wire.strict import Rejected


class JobTracker:
    """Asks about jobs over a link, and keeps a feed of each job that a handle is of. Use it only on the link's loop.

    Args:
        link: the session with the cluster; `close` closes it.
    """

    def __init__(self, link: Link) -> None:
        self._link = link
        self._loop = asyncio.get_running_loop()
        # Weak: a feed lives as long as a handle of its job, so a client that runs for weeks does not collect feeds.
        self._feeds: weakref.WeakValueDictionary[str, JobFeed] = weakref.WeakValueDictionary()
        self._improvement_listeners: list[Callable[[Improvement], None]] = []
        self._closed = False
        self._results: asyncio.Task[ModuleType] | None = None
        link.listen(link.keys.best, self._hear_best)
        link.listen(link.keys.state, self._hear_state)

    def feed(self, job: str) -> JobFeed:
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

    def listen_to_improvements(self, hear: Callable[[Improvement], None]) -> None:
        """Call ``hear`` with each improvement of any job; see `AsyncClient.listen_to_improvements`."""
        self._improvement_listeners.append(hear)

    async def ask(self, request: wire.Request, patience: float = PATIENCE) -> Any:
        """Send a request and return the value of its answer; see `AsyncClient.ask`."""
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

    def results(self) -> "asyncio.Task[ModuleType]":
        """Return a task that imports `supernode.runs.results`.

        The import takes a second (it loads numpy and the problems), so it runs in a thread while the loop goes on.
        """
        if self._results is None:
            self._results = asyncio.create_task(asyncio.to_thread(_imported_results))
        return self._results

    def now(self) -> float:
        """Return the loop's time, s."""
        return self._loop.time()

    async def close(self) -> None:
        """Close the link; wake all that wait in `more`, which then raises. May be called more than once."""
        if self._closed:
            return
        self._closed = True
        for feed in list(self._feeds.values()):
            if feed.looking is not None:
                feed.looking.cancel()
            feed.wake()
        await self._link.close()

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


def _imported_results() -> ModuleType:
    from supernode.runs import results

    return results
