"""End an epoch or a job: have the spy judge it, and ask the oracle once more."""

import contextlib
from dataclasses import replace

from coordinator.errors import ClusterFailed
from coordinator.jobs.calls import GivenUpError, better_of
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.job import StopRequest
from spy.judgement import STATUS_OF, Judgement
from spy.past import stopped_after
from spy.result import states_of, stop_reasons
from topologies import ROOT
from wire.control import Finish, Judged
from wire.news import Improvement
from wire.report import Proposal


class Ending:
    """Gets the judgement of an epoch or a job, however it ends."""

    def __init__(self, job: ConductedJob) -> None:
        self._job = job

    def judge(self, error: str | None) -> Judgement:
        """Have the spy judge the epoch that has stopped.

        Args:
            error: why a cell failed, if one did.

        Raises:
            ClusterFailed: if the spy does not answer as it should.
            ReplacedError: if the spy died; the caller prepares the new one and tries again.
        """
        job = self._job
        self._restore_a_lost_stop()
        job.pass_on_histories()
        past, lived = job.epochs.whole()
        epoch, reports = job.epoch, lived.reports
        command = Finish(
            job.number,
            epoch.number,
            past.or_better(lived),
            stopped_after(reports),
            stop_reasons(reports, epoch.file.run.mode),
            error,
            tuple(states_of(reports).items()),
            job.epochs.since - job.lived_before,
        )
        (answer,) = job.calls.ask([(job.keys.spy_control, command)], give_up=False)
        if not isinstance(answer, Judged):
            raise ClusterFailed("the spy did not judge the run")
        judgement = Judgement.of(answer)
        if judgement.best is not None:
            job.improve(judgement.best)  # the spy has published it, but that message may still be on its way
        job.entry.log.end(judgement, command.generation)
        return judgement

    def _restore_a_lost_stop(self) -> None:
        """Note the proposal of a stop from outside that all cells have obeyed, but none reports.

        The root had proposed it and died. The process that took its place learned of the stop from its neighbours.
        """
        job = self._job
        request, reports = job.stop_request, job.epoch.reports
        if request is None or job.epoch.file.run.mode != "lockstep" or ROOT not in reports:
            return
        if not stop_reasons(list(reports.values()), "lockstep"):
            stop, root = stopped_after(list(reports.values())), reports[ROOT]
            lost = Proposal(stop, request.reason, ROOT, stop)
            reports[ROOT] = replace(root, proposals=(*root.proposals, lost))

    def with_the_oracle(self, judgement: Judgement) -> Judgement:
        """Return the judgement, completed by the oracle's answer if the run has stalled for good or is infeasible.

        This waits for an oracle that still works (for a limited time, see `Consulting`), unless the job is stopped or
        the cluster fails meanwhile.
        """
        job = self._job
        if not judgement.is_open:
            return judgement
        job.oracle.ask()
        with contextlib.suppress(ClusterFailed):
            while (look_at := job.oracle.look_at) is not None:
                if isinstance(job.calls.next(look_at), StopRequest):
                    break
                job.oracle.look()
        bounds = job.oracle.bounds
        if bounds is None:
            return judgement
        job.entry.log.write("oracle", says=bounds.words)
        return judgement.with_oracle(bounds)

    def as_requested(self, judgement: Judgement) -> Judgement:
        """Return the judgement with the status of the stop request, for a job that would have continued without it."""
        assert self._job.stop_request is not None
        return replace(judgement, status=STATUS_OF[self._job.stop_request.reason], next_attempt=None)

    def after(self, error: Exception) -> Judgement:
        """Return the judgement of a job that an exception has ended."""
        best = self._best_of_all()
        if isinstance(error, GivenUpError):
            status = STATUS_OF[error.stop_request.reason]
            if best is None:
                return Judgement(status, False, "stopped before there was a result", None)
            return Judgement(status, best.feasible, None, best)
        if isinstance(error, ClusterFailed):
            # A job that was cancelled, but had not stopped when the cluster was closed, is cancelled all the same.
            stop_request = self._job.stop_request
            cancelled = stop_request is not None and stop_request.reason == "cancel" and self._job.calls.closing
            return Judgement("cancelled" if cancelled else "failed", False, str(error), best)
        return Judgement("failed", False, f"{type(error).__name__}: {error}", best)  # some mistake; clients wait

    def _best_of_all(self) -> Improvement | None:
        """Return the best answer to the problem of the latest epoch that anybody may know, though no spy judges it.

        A client may have been told one that no coordinator has heard: while none lived, or as the router died.
        """
        job = self._job
        if not job.nodes:  # it never ran, or its answer was asked for as it was queued again
            return job.best
        epoch = job.epoch.number if job.epochs else job.epochs.past.epochs
        told = job.calls.best_told(job.keys.spy_control, job.number)  # before `job.best` is read: better ones may come
        return better_of(job.best, told, epoch)
