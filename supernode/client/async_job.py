"""A handle of a job on a running cluster, for programs that use asyncio."""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coordinator.jobs.states import ENDS
from problems import ProblemFile
from problems.errors import UPDATE_OF, BadInput
from problems.file import filled_in, load_patch
from supernode.client.job_feed import WAITING, JobFeed
from supernode.client.job_tracker import JobTracker
from wire import jobs as wire
from wire.news import Improvement

if TYPE_CHECKING:
    from spy.result import Result

_BEGUN_WITHIN = 2.0  # seconds after which an epoch is taken to have begun even if no message said so (one may be lost)


class AsyncClientJob:
    """A handle of a job on a running cluster, for asyncio.

    `AsyncClient.submit` and `AsyncClient.job` return one. Several handles of one job may exist; they share what the
    client knows of it. A handle does not keep the job running, and dropping it does not cancel the job.
    """

    def __init__(self, tracker: JobTracker, feed: JobFeed) -> None:
        self._tracker = tracker
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
            await self._tracker.more(feed)
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
            await self._tracker.more(feed)
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
                    await self._tracker.more(self._feed)
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
        results = self._tracker.results()  # importing goes on while the job runs
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
                    await self._tracker.more(self._feed)
        except TimeoutError:
            raise TimeoutError(f"job {self.id} has not ended within {timeout} s") from None
        return self._feed.end

    async def show(self) -> dict[str, Any]:
        """Return all that the cluster knows of the job now, as plain values.

        The keys, such as "status", "best", "result", "epochs" and "file", are described in docs/protocol.md.
        """
        return await self._tracker.look(self._feed)

    async def state(self) -> str:
        """Return the job's state now, such as "queued", "running" or "solved"."""
        return str((await self.show())["status"])

    async def cancel(self) -> str:
        """End the job; its result is the best found so far.

        Returns:
            The job's state before it was cancelled. A job that has ended already is left as it is.
        """
        told = await self._tracker.ask(wire.Cancel(self.id))
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
        told = await self._tracker.ask(request)
        self._epoch = int(told["epoch"])
        self._patient_until = self._tracker.now() + _BEGUN_WITHIN
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
        return self._epoch == 0 or begun or self._tracker.now() >= self._patient_until
