"""Keep the view up to date: listen to the cluster, ask it now and then, and reconnect when it was away."""

import asyncio
import contextlib
from collections.abc import Callable

from coordinator.errors import ClusterFailed
from problems import BadInput
from supernode.client.async_client import AsyncClient
from supernode.client.cluster_info import Place
from supernode.live.view import View
from wire import jobs as wire
from wire.strict import Rejected

PATIENCE = 5.0  # seconds without an answer; a coordinator that died has been replaced by then
LISTED = 100  # jobs
_AGAIN = 0.5  # seconds between two attempts to connect, and at least between two questions
_GIVEN_UP_AFTER = 30.0  # seconds without an answer after which to connect anew
_LOOK_EVERY = 2.0  # seconds between two questions if nothing changes
_NODES_A_SECOND = 32  # `status` is asked no more often than this allows: the coordinator reads each node's memory


class Watcher:
    """Watches one cluster and feeds the view; runs on one asyncio loop."""

    def __init__(self, place: Place, view: View) -> None:
        self._place = place
        self._view = view
        self._client: AsyncClient | None = None
        self._news = asyncio.Event()

    @property
    def client(self) -> AsyncClient:
        """The client of the cluster.

        Raises:
            ClusterFailed: while the cluster cannot be reached.
        """
        if self._client is None:
            raise ClusterFailed(self._view.trouble or "the cluster has not answered yet")
        return self._client

    async def run(self) -> None:
        """Watch until cancelled; reconnect whenever the link is lost."""
        while True:
            try:
                async with await AsyncClient.open(self._place) as client:
                    self._listen(client)
                    self._client = client
                    await self._look(client)
            except (ClusterFailed, BadInput) as error:
                self._view.lost(str(error))
            except Exception as error:  # such as the answers of another version: pages must say so, not freeze
                self._view.lost(f"the cluster's answer cannot be read: {type(error).__name__}: {error}")
            finally:
                self._client = None
            await asyncio.sleep(_AGAIN)

    def _listen(self, client: AsyncClient) -> None:
        view, keys = self._view, client.keys
        view.begin()
        for key, hear in (
            (keys.spy_counters, view.hear_counters),
            (keys.spy_stats, view.hear_statistics),
            (keys.log, view.hear_log),
        ):
            client.listen(key, _forgiving(hear))
        client.listen_to_improvements(view.hear_improvement)
        client.listen(keys.state, lambda _: self._news.set())
        client.watch(keys.any_life, view.hear_life)

    async def _look(self, client: AsyncClient) -> None:
        """Ask for the jobs whenever one has changed, and for the nodes now and then.

        A busy cluster may be slow, so one missing answer is only shown.

        Raises:
            ClusterFailed: if another cluster has taken its place, or nothing has answered for long.
        """
        loop, info = asyncio.get_running_loop(), self._place.info()
        status_due, given_up = 0.0, loop.time() + _GIVEN_UP_AFTER
        while True:
            self._news.clear()
            try:
                jobs = await client.ask(wire.ListJobs(LISTED), PATIENCE)
                self._view.hear_jobs(jobs, all_of_them=len(jobs) < LISTED)
                if loop.time() >= status_due:
                    status = await client.ask(wire.Status(), PATIENCE)
                    self._view.hear_status(status)
                    status_due = loop.time() + max(_LOOK_EVERY, len(status["nodes"]) / _NODES_A_SECOND)
                self._view.found()
                given_up = loop.time() + _GIVEN_UP_AFTER
            except ClusterFailed as error:
                if loop.time() > given_up or self._place.info() != info:
                    raise
                self._view.lost(str(error))
            await asyncio.sleep(_AGAIN)
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_LOOK_EVERY - _AGAIN):
                    await self._news.wait()


def _forgiving(hear: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """Wrap a handler so that messages that cannot be read are ignored."""

    def forgiving(payload: bytes) -> None:
        with contextlib.suppress(Rejected):
            hear(payload)

    return forgiving
