"""What all requests of one dashboard share: the model of the cluster, and answers that serve many viewers."""

import asyncio
from collections import OrderedDict
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request

from coordinator.errors import ClusterFailed
from supernode.client.cluster_info import Place
from supernode.dashboard.metrics import Metrics
from supernode.dashboard.parsing import Parser
from supernode.dashboard.scenes import Scenes
from supernode.dashboard.streams import Streams
from supernode.live.view import View
from supernode.live.watcher import PATIENCE, Watcher
from wire import jobs as wire

_FRESH = 0.5  # seconds for which an answer of the cluster is shared by all requests that ask the same
_KEPT = 256  # such answers
_SHOW_EVERY = 1.0  # seconds between two questions about a job, at least: each answer holds whole problem files
_SHOW_AGAIN = 5.0  # seconds after which a job is asked for again although nothing was received about it
_SHOWN = 16  # answers about jobs that are kept, each with its problem file


@dataclass(frozen=True)
class _Shown:
    """The cluster's answer about a job, with when it was asked for (loop time) and what was known of the job then."""

    heard: Any
    asked: float
    answer: asyncio.Task[dict[str, Any]]

    def is_good(self, heard: Any, now: float) -> bool:
        """Return whether the answer may be used, given what is known of the job now."""
        if now < self.asked:  # the question waits for its turn; whoever asks now waits with it
            return True
        if self.answer.done() and (self.answer.cancelled() or self.answer.exception() is not None):
            return False
        return self.heard == heard and now - self.asked < _SHOW_AGAIN


class Dashboard:
    """The state that all requests of one dashboard share; only the server's loop may use it."""

    def __init__(self, place: Place) -> None:
        self.view = View()
        self.watcher = Watcher(place, self.view)
        self.streams = Streams(self.view.snapshot, self.view.news, self.view.improvements)
        self.scenes = Scenes()
        self.metrics = Metrics(self.view)
        self.parser = Parser()
        self._answers: dict[wire.Request, tuple[float, asyncio.Task[Any]]] = {}
        self._shown: OrderedDict[str, _Shown] = OrderedDict()

    async def ask(self, request: wire.Request) -> Any:
        """Return the cluster's answer, at most half a second old: many viewers cost the cluster no more than one."""
        now = asyncio.get_running_loop().time()
        asked, answer = self._answers.get(request, (-_FRESH, None))
        if answer is None or now - asked >= _FRESH:
            self._answers = {key: each for key, each in self._answers.items() if now - each[0] < _FRESH}
            if len(self._answers) >= _KEPT:
                raise ClusterFailed("too many questions at once")
            answer = asyncio.create_task(self.watcher.client.ask(request, PATIENCE))
            self._answers[request] = (now, answer)
        return await asyncio.shield(answer)  # shared: a viewer that leaves must not cancel it for the others

    async def show(self, job: str) -> Mapping[str, Any]:
        """Return all about a job; one answer serves all viewers until something new is received about the job.

        Its best answer is the latest improvement that was received, if the cluster's answer does not have it yet.
        """
        heard, now = self.view.heard_of(job), asyncio.get_running_loop().time()
        known = self._shown.get(job)
        if known is None or not known.is_good(heard, now):
            due = now if known is None else max(now, known.asked + _SHOW_EVERY)
            known = self._shown[job] = _Shown(heard, due, asyncio.create_task(self._show(job, due - now)))
            self._shown.move_to_end(job)
            while len(self._shown) > _SHOWN:
                self._shown.popitem(last=False)
        return self.view.completed(await asyncio.shield(known.answer))  # shared as well

    async def _show(self, job: str, after: float) -> dict[str, Any]:
        await asyncio.sleep(after)
        view: dict[str, Any] = await self.watcher.client.ask(wire.Show(job), PATIENCE)
        return {name: value for name, value in view.items() if name not in ("file", "epochs")}


def dashboard_of(request: Request) -> Dashboard:
    """Return what a request shares with all others."""
    dashboard: Dashboard = request.app.state.dashboard
    return dashboard
