"""Answer clients' requests. A new job is checked, stored and handed to the dispatcher before it is acknowledged."""

import dataclasses
import json
import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Literal

import topologies
from coordinator.errors import ClusterFailed
from coordinator.jobs.calls import better_of
from coordinator.jobs.checkpoint import CHECKPOINT_EVERY, Checkpoint
from coordinator.jobs.hooks import JobRunner
from coordinator.jobs.job import JobSpec, Placement
from coordinator.jobs.scheduler import QueueFull
from coordinator.jobs.states import ENDS, LIVING
from coordinator.service.checking import Checker, is_own
from coordinator.store.database import StoreFailed
from coordinator.store.job_store import Store
from coordinator.store.record_book import RecordBook
from coordinator.store.recorder import Recorder, log_record, state_of
from coordinator.store.stored_job import Answered, Stored, Submission, Summary
from problems import BadInput, ProblemFile
from problems.digests import digest
from problems.errors import blaming_the_update, one_line
from spy.past import Lived, Past
from wire.jobs import (
    MOST_LISTED,
    VERSION,
    Answer,
    Cancel,
    Done,
    Down,
    JobState,
    ListJobs,
    Logs,
    Records,
    Refused,
    Request,
    Rewire,
    Show,
    Status,
    Submit,
    Update,
)
from wire.keys import ANYONE
from wire.news import Improvement

_FAILURES = (ClusterFailed, QueueFull, StoreFailed)  # not the client's fault


class RequestHandler:
    """Answers requests on any thread; but changes of one job (updates and rewirings) must come one after another.

    Args:
        cluster: the name of the cluster.
        store: the jobs.
        book: the records of the jobs.
        recorder: writes what the dispatcher reports.
        dispatcher: runs the jobs.
        checker: checks problems, and knows which users' modules may be run.
        publish: called with each new job's first states.
        checkpoint_every: seconds from one checkpoint of a job to the next; None for no checkpoints.
        ends: what ends when a client sends `Down`: the cluster, or only the coordinator.
        unprotected: endpoints of a network where whoever reaches them can use the cluster.
    """

    def __init__(
        self,
        cluster: str,
        store: Store,
        book: RecordBook,
        recorder: Recorder,
        dispatcher: JobRunner,
        checker: Checker,
        publish: Callable[[JobState], None],
        checkpoint_every: float | None = CHECKPOINT_EVERY,
        ends: Literal["cluster", "coordinator"] = "cluster",
        unprotected: Sequence[str] = (),
    ) -> None:
        self._cluster = cluster
        self._store = store
        self._book = book
        self._recorder = recorder
        self._dispatcher = dispatcher
        self._checker = checker
        self._publish = publish
        self._checkpoint_every = checkpoint_every
        self._ends = ends
        self._unprotected = unprotected
        self._began = time.time()
        self._handed_over: set[int] = set()  # numbers of the jobs that the dispatcher has

    def answer(self, request: Request, client: str = ANYONE) -> Answer:
        """Carry out a request of a client and return its answer; every exception becomes a refusal."""
        try:
            return Done(self._do(request, client))
        except BadInput as error:
            return Refused(str(error), "input")
        except _FAILURES as error:
            return Refused(one_line(str(error)), "failure")
        except Exception as error:  # a mistake here must not leave the client without an answer
            return Refused(one_line(f"{type(error).__name__}: {error}"), "failure")

    def restore(self) -> None:
        """Hand the jobs of the previous coordinator to the dispatcher, running ones first: they must keep their nodes.

        A running job that cannot be taken over is queued again; one past its deadline ends without a result. Those that
        clients have cancelled are cancelled again: what was sent of that may be lost.
        """
        unended = self._store.unended()
        living = [job for job in unended if job.status in (*LIVING, "deadline") and job.nodes]
        adopted = {job.number for job in living if self._adopted(job)}
        for job in unended:
            if job.number in adopted:
                pass
            elif job.status == "deadline":  # its clients have their answer already
                self._recorder.ended(job.number, ClusterFailed("stopped before there was a result"))
            else:
                self._queue_again(job)
            if job.is_cancelled:
                self._dispatcher.cancel(job.number)

    def forget(self, number: int) -> None:
        """Note that a job has ended."""
        self._handed_over.discard(number)

    def _do(self, request: Request, client: str) -> Any:
        value: Any
        match request:
            case Submit():
                value = self._submit(request, client)
            case ListJobs(limit):
                value = [_line(job) for job in self._store.newest(MOST_LISTED if limit is None else limit)]
            case Show(job, brief):
                value = _answer(self._store.answer(job)) if brief else self._show(job)
            case Records(kind, job, after):
                value = self._book.page(kind, job, after)
            case Logs(job, node, after):
                value = self._book.log(job, node, after)
            case Cancel(job):
                value = self._cancel(job)
            case Update(job, patch):
                value = self._update(job, json.loads(patch))
            case Rewire(job, topology):
                value = self._rewire(job, topology)
            case Status():
                value = self._status()
            case Down():
                value = {"ends": self._ends}  # the service stops itself once this answer is on its way
        return value

    # Submitting -------------------------------------------------------------------------------------------------------
    def _submit(self, request: Submit, client: str) -> dict[str, Any]:
        file = self._checker.read(request.file)
        if file.attempt or file.attempt_fields:
            raise BadInput(f"{file.name}: expected a problem file, found one that was tried before")
        if "topology" not in file.run.model_fields_set:
            file = file.with_run(topology=self._dispatcher.topology)
        self._checker.check(file)  # may take long; nothing is locked yet
        topology = topologies.parse(file.run.topology)
        described = (file.to_json(), digest_of(file), file.kind, topology.spec, topology.cells)
        new = Submission(*described, request.priority, client)
        with self._recorder.paused():  # else "running" could be published before "submitted"
            job, is_new = self._store.add(new, request.id)
            if is_new:
                self._hand_over_new(job, file)
            elif job.status not in ENDS and job.number not in self._handed_over:
                # The job was stored, but the store reported a failure then (as when a connection breaks during the
                # commit), so it was never handed over. The client submits it again.
                self._queue_again(self._store.show(job.job))
        return {"job": job.job, "status": job.status}

    def _hand_over_new(self, job: Summary, file: ProblemFile) -> None:
        """Hand a new job over and publish its first states; if the dispatcher refuses, remove it from the store."""
        try:
            self._hand_over(job, self._spec(job, file))
        except Exception:  # the client gets a refusal, so a later coordinator must not find the job
            self._store.withdraw(job.number)
            raise
        for status in ("submitted", "queued"):
            self._publish(dataclasses.replace(state_of(job, job.submitted), status=status))

    def _hand_over(self, job: Summary, spec: JobSpec, accepted_before: bool = False) -> None:
        self._handed_over.add(job.number)  # first: the job may end, and be forgotten, before `submit` returns
        try:
            self._dispatcher.submit(spec, accepted_before=accepted_before)
        except BaseException:
            self._handed_over.discard(job.number)
            raise

    def _queue_again(self, job: Stored) -> None:
        """Let a stored job go on from its latest checkpoint, or start over; end it as failed if neither is possible."""
        best = _best_of(job)
        if job.status != "queued":
            best = self._with_the_last_told(job, best)
            self._recorder.changed(job.number, "queued", ())
        try:
            first, file = self._checker.read(job.file), self._checker.read(job.file_now)
            spec = dataclasses.replace(self._spec(job, file), best=best, first=first)
            if (checkpoint := self._checkpoint_of(job)) is not None:
                spec = dataclasses.replace(spec, past=checkpoint.past, checkpoint=checkpoint)
            else:
                spec = dataclasses.replace(spec, past=self._past_of(job, file))
            self._hand_over(job, spec, accepted_before=True)
        except Exception as error:
            self._recorder.ended(job.number, error)

    def _with_the_last_told(self, job: Stored, best: Improvement | None) -> Improvement | None:
        """Return the best answer, which may be one that the spy told while no coordinator lived to store it."""
        better = better_of(best, self._dispatcher.best_told(job.number), job.epoch)
        if better is not None and better is not best:
            self._recorder.improved(job.number, better)
        return better

    def _checkpoint_of(self, job: Stored) -> Checkpoint | None:
        """Return the latest checkpoint of the epoch that a job is in, if there is one that is whole."""
        for data in self._store.checkpoints(job.number):
            try:
                checkpoint = Checkpoint.decode(data, self._checker)
            except BadInput as error:
                self._recorder.logged(log_record("warning", f"a checkpoint is left out: {error}", job.number))
            else:
                if checkpoint.epoch == job.epoch:
                    return checkpoint
        return None

    def _keep_checkpoint(self, number: int, checkpoint: Checkpoint) -> None:
        """Store a checkpoint of a job. If that fails, log it: the job goes on without."""
        try:
            self._store.keep_checkpoint(number, checkpoint.encode())
        except StoreFailed as error:
            self._recorder.logged(log_record("warning", f"no checkpoint: {error}", number))

    def _spec(self, job: Summary, file: ProblemFile) -> JobSpec:
        """Return a job for the dispatcher, with its time of submission moved from Unix time to the monotonic clock."""
        submitted = time.monotonic() - max(0.0, time.time() - job.submitted)
        spec = JobSpec(job.number, file, None, job.job, job.priority, submitted)
        return dataclasses.replace(
            spec,
            client=job.client,
            checkpoint_every=self._checkpoint_every,
            keep_checkpoint=partial(self._keep_checkpoint, job.number),
            say=lambda text: self._recorder.logged(log_record("info", text, job.number)),
        )

    def _past_of(self, job: Stored, file: ProblemFile) -> Past:
        """Return the past of a job that starts over: all its epochs so far, the last of them without reports."""
        if job.epoch == 0:  # a first epoch is repeated draw by draw, so nothing of it counts
            return Past()
        past, why = self._store.past(job.number)
        if past.epochs < job.epoch:
            past = past.and_then(Lived(file, number=job.epoch - 1), why)
        return past.and_then(Lived(file, number=job.epoch), {"do": "restart"})

    def _adopted(self, job: Stored) -> bool:
        """Let the dispatcher take over a running job; return whether it could."""
        try:
            first, file = self._checker.read(job.file), self._checker.read(job.file_now)
            past, why = self._store.past(job.number)
            placement = Placement(job.epoch, file, job.nodes, job.wiring, why, past, _best_of(job))
            spec = dataclasses.replace(self._spec(job, first), checkpoint=self._checkpoint_of(job))
            self._dispatcher.adopt(spec, placement)
        except Exception as error:
            self._recorder.logged(
                log_record(
                    "warning", f"the job cannot go on from where it was: {type(error).__name__}: {error}", job.number
                )
            )
            return False
        self._handed_over.add(job.number)
        return True

    # Stored jobs ------------------------------------------------------------------------------------------------------
    def _show(self, job: str) -> dict[str, Any]:
        stored = self._store.show(job)
        transitions = [list(each) for each in self._store.transitions(stored.number)]
        return _answer(stored) | {
            "file": stored.file,
            "file_now": stored.file_now,
            "epochs": self._store.epochs(stored.number),
            "states": transitions,
        }

    def _cancel(self, job: str) -> dict[str, Any]:
        found = self._store.summary(job)
        if found.status not in ENDS:
            self._dispatcher.cancel(found.number)  # first: it must work while the disk is full
            self._store.note_cancel(found.number)
        return {"job": job, "status": found.status}

    def _update(self, job: str, patch: dict[str, Any]) -> dict[str, Any]:
        now = self._running(job)
        before = self._checker.read(now.file_now)
        if is_own(before):  # problems of built-in kinds are checked by the conductor, without a user's code
            with blaming_the_update():
                self._checker.check(before.changed(patch, {}), before)
        epoch = self._dispatcher.update(now.number, patch)
        return {"job": job, "epoch": epoch}

    def _rewire(self, job: str, topology: str) -> dict[str, Any]:
        now = self._running(job)
        before = self._checker.read(now.file_now)
        file = before.with_run(topology=topology)
        cells = topologies.parse(file.run.topology).cells
        if cells != now.cells:
            raise BadInput(f"topology: expected one of {now.cells} cells, as the job has, found {cells}")
        epoch = self._dispatcher.rewire(now.number, file.run.topology)
        return {"job": job, "epoch": epoch}

    def _running(self, job: str) -> Stored:
        stored = self._store.show(job)
        if stored.status not in ("preparing", *LIVING):  # the job may run already, but not be stored as running yet
            has = "has ended: it is" if stored.status in ENDS else "does not run yet: it is"
            raise BadInput(f"job {job!r} {has} {stored.status}")
        return stored

    def _status(self) -> dict[str, Any]:
        return {
            "cluster": self._cluster,
            "version": _version(),
            "protocol": VERSION,
            "seconds": time.time() - self._began,
            "spy": self._dispatcher.spy(),
            "nodes": self._dispatcher.nodes(),
            "placements": self._dispatcher.placements(),
            "jobs": self._store.counts(),
            "unprotected": list(self._unprotected),
        }


def digest_of(file: ProblemFile) -> str:
    """Return a digest that is equal for equal problems and settings, whatever the name of the file."""
    settings = file.run.model_dump(exclude_unset=True)
    return digest([file.fields, settings])


def _best_of(job: Stored) -> Improvement | None:
    """Return the best answer that the recorder has stored; in JSON an infinite fitness is null."""
    if job.best is None:
        return None
    fitness = job.best["fitness"]
    return Improvement(**{**job.best, "fitness": math.inf if fitness is None else fitness})


def _answer(job: Answered) -> dict[str, Any]:
    return _line(job) | {"best": job.best, "result": job.result, "epoch": job.epoch, "nodes": list(job.nodes)}


def _line(job: Summary) -> dict[str, Any]:
    shown = ("job", "number", "kind", "status", "fitness", "submitted", "started", "ended", "cells", "client")
    return {name: getattr(job, name) for name in (*shown, "topology", "priority", "message")}


def _version() -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version("supernode")
    except PackageNotFoundError:
        return "unknown"
