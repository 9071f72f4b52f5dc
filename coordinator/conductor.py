"""Conduct one job: prepare and start its nodes, pass stop requests on, gather reports, have the result verified.

A job is a sequence of epochs. An update of the problem, a new topology and the replacement of a dead node all work the
same way: the conductor prepares the next epoch on every node and begins it, the previous epoch is stopped, and each
node continues in the next one with the deme that it has. A node that receives the command to begin finishes the
previous epoch first. At most two epochs are in progress at any time.

Threads: each conductor runs on a thread of its own and is driven by one queue (see `coordinator.calls`). Zenoh's
network thread calls only `improve`, which takes a lock. The conductor's thread alone touches everything else.
"""

import contextlib
import json
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

import zenoh

import topologies
from coordinator.calls import ASK_AGAIN, Calls, GivenUpError, ReplacedError, Reported
from coordinator.consulting import Consulting
from coordinator.epochs import Epoch, Epochs
from coordinator.errors import ClusterFailed
from coordinator.job import BegunAnew, Change, JobEntry, Placement, Replaced, StopRequest
from node.plan import retry
from problems import BadInput, ProblemFile
from problems.errors import blaming_the_update
from spy.improvement_records import ImprovementRecord, records_of
from spy.past import Lived, lived_for, stopped_after
from spy.result import Clocks, Result, result_of, states_of, stop_reasons
from spy.verification import STATUS_OF, Judgement
from topologies import ROOT
from wire.control import Begin, Done, Drop, Finish, Halt, Judged, Look, Prepare, ProposeStop, Wiring
from wire.keys import Keys
from wire.news import Improvement
from wire.report import Reason, Report
from wire.seal import Seal

_FOUND_WITHIN = 1.0  # seconds; a running node finds a restarted router in a fifth of that
_HALTED_WITHIN = 60.0  # seconds
_LASTING = ("solved", "stalled")  # endings after which a job may continue, by another attempt or in another epoch


class Dispatch(Protocol):
    """The interface that a conductor needs from the dispatcher; called on the conductor's thread and on Zenoh's."""

    @property
    def cluster_nodes(self) -> int:
        """The number of nodes in the cluster, busy or free."""

    def wire(self, nodes: tuple[int, ...], topology: str, fresh: bool = False) -> Wiring:
        """Return the links for an epoch: the existing ones if all its nodes share them, else (or if ``fresh``) new."""

    def changed(self, job: JobEntry, status: str) -> None:
        """Record that the job has entered another state."""

    def placed(self, job: JobEntry, placement: Placement) -> None:
        """Record that the job is about to begin this epoch."""

    def improved(self, job: JobEntry, better: Improvement) -> None:
        """Record a better answer."""

    def lived(self, job: JobEntry, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """Record the improvements of an epoch that has ended."""


class Conductor:
    """The conductor of one job.

    Args:
        job: the job; its queue is this conductor's mailbox.
        session: a Zenoh session through the router.
        seal: signs commands for the cluster's processes.
        keys: the key expressions of the cluster.
        nodes: the nodes of the job, in the order of its cells. Empty if the job must end without ever having run: then
            the conductor only reads its queue for the reason.
        dispatch: the dispatcher that runs this conductor.
        replaces: whether the cluster replaces dead processes.
        adopted: the state of the job, if it was running when the previous coordinator died.
    """

    def __init__(
        self,
        job: JobEntry,
        session: zenoh.Session,
        seal: Seal,
        keys: Keys,
        nodes: tuple[int, ...],
        dispatch: Dispatch,
        *,
        replaces: bool = False,
        adopted: Placement | None = None,
    ) -> None:
        self.job = job
        self.number = job.spec.number
        self.keys = keys
        self.nodes = nodes
        self.dispatch = dispatch
        self.calls = Calls(session, seal, job.queue, replaces)
        self.epochs = Epochs(job.spec.past if adopted is None else adopted.past)
        self.versions: dict[str, str] = {}
        self.best = job.spec.best if adopted is None else adopted.best
        self._improving = threading.Lock()
        self.seconds = 0.0
        self._adopted = adopted
        self._checked = replaces  # in a cluster that stays up the request handler has checked the problem already
        self._spy_is_new = False  # the spy was replaced and does not know this job yet
        self._lived_before = 0  # generations of the job when it last began with new demes
        self._stop_request: StopRequest | None = None  # the first one; later ones do not change the job's status
        self._changes: deque[Change] = deque()  # requested, but not begun
        self._unsent_stop: StopRequest | None = None  # a stop that must still be sent to the cells of the latest epoch
        self._ask_at: float | None = None  # when to ask for reports again; on the monotonic clock
        self._oracle = Consulting()

    @property
    def epoch(self) -> Epoch:
        """The latest epoch."""
        return self.epochs.latest

    def conduct(self, seconds_to_ready: float, cpu_seconds: Callable[[], dict[str, float]]) -> Result:
        """Run the job to its end and return its result.

        A cluster that fails or a problem that breaks while it runs is a result of status "failed", not an exception.

        Args:
            seconds_to_ready: how long the cluster took to start, for the result.
            cpu_seconds: returns the CPU time that each process has used so far, by name.

        Raises:
            BadInput: if the problem is wrong.
        """
        used = cpu_seconds()
        judgement = self._judgement()
        if judgement.best is not None:
            self.improve(judgement.best)
        # A process that came meanwhile has no earlier figure; one that went has no later one.
        spent = sum(after - used[name] for name, after in cpu_seconds().items() if name in used)
        clocks = Clocks(self.seconds, seconds_to_ready, spent)
        spec = self.job.spec
        never_begun = spec.past, Lived(spec.file, number=spec.past.epochs)
        past, epoch = self.epochs.whole() if self.epochs else never_begun
        name = spec.job or str(self.number)
        return result_of(name, spec.first_run or spec.file.run, past, epoch, judgement, self.versions, clocks)

    def improve(self, better: Improvement) -> None:
        """Publish an answer if it is better than the best known one; ignore it otherwise. Thread-safe.

        Answers of an earlier epoch are ignored too: they may solve another problem, or may still be on their way when
        the next epoch has begun.
        """
        with self._improving:
            now = bool(self.epochs) and better.epoch == self.epoch.number
            if now and (self.best is None or better.fitness < self.best.fitness):
                self._tell(better)

    def _tell(self, better: Improvement) -> None:
        self.best = better
        self.job.log.news(self.epoch.topology, better)
        self.job.tell(better)
        self.dispatch.improved(self.job, better)

    def _pass_on_histories(self) -> None:
        """Report the improvements of epochs that have ended; called before each new epoch and at the end of the job."""
        for past, epoch in self.epochs.untold():
            records = records_of(past, epoch.lived)
            self.job.note(epoch.topology, records)
            self.dispatch.lived(self.job, epoch.number, records)

    def _answer_for(self, epoch: Epoch) -> Improvement | None:
        """Return the best answer so far if it is still an answer to the problem of ``epoch``; else None.

        An update changes the problem, so older answers no longer count. After a retry the answer keeps the epoch that
        it was found in: the new attempt has not found it.
        """
        best, do = self.best, epoch.why.get("do")
        if best is None or (best.epoch < epoch.number and do == "update"):
            return None
        return best if do == "retry" else best.carried_to(epoch.number)

    def _judgement(self) -> Judgement:
        """Run the job and return its judgement, also if the cluster fails.

        Raises:
            BadInput: if the problem is wrong.
        """
        try:
            return self._with_the_oracle(self._run())
        except GivenUpError as error:
            status, best = STATUS_OF[error.stop_request.reason], self.best
            if best is None:
                return Judgement(status, False, "stopped before there was a result", None)
            return Judgement(status, best.feasible, None, best)
        except ClusterFailed as error:
            # A job that was cancelled, but had not stopped when the cluster was closed, is cancelled all the same.
            cancelled = self._stop_request is not None and self._stop_request.reason == "cancel" and self.calls.closing
            return Judgement("cancelled" if cancelled else "failed", False, str(error), self.best)
        except BadInput:
            raise
        except Exception as error:  # any mistake must still end the job: clients wait for its result
            return Judgement("failed", False, f"{type(error).__name__}: {error}", self.best)
        finally:
            self._oracle.close()
            if self.nodes:
                self._drop()  # also if the job failed: nodes must not go on breeding for it

    def _run(self) -> Judgement:
        """Run epoch after epoch until the job ends; return the judgement of the last one.

        Raises:
            GivenUpError: if the job is stopped before it has begun.
            ClusterFailed: if it cannot continue.
            BadInput: if the problem is wrong.
        """
        if not self.nodes:
            raise GivenUpError(self._stop_in_the_queue())
        if self._adopted is None:
            self._set_out(self.epochs.past.epochs, self.job.spec.file)
        else:
            self._take_over(self._adopted)
        began = time.monotonic()
        try:
            while True:
                judgement = self._live()
                # The spy decides whether there is to be another attempt, see `spy.verification`.
                seeks, waits = judgement.next_attempt is not None, self.epoch.file.run.keep_alive
                if judgement.status not in _LASTING or not (seeks or waits):
                    return judgement
                if self._stop_request is not None:  # it came when the epoch was about to end by itself
                    return self._ended_as_requested(judgement) if seeks else judgement
                if seeks:
                    if judgement.has_oracle:
                        self._oracle.ask()
                    self._try_again(judgement)
                elif not self._wait_for_a_change():
                    return self._ended_as_requested(judgement)
        finally:
            self.seconds = time.monotonic() - began  # since the first epoch began, or this coordinator took over

    # The beginning of a job -------------------------------------------------------------------------------------------
    def _set_out(self, number: int, file: ProblemFile) -> None:
        """Prepare and begin an epoch on nodes that hold no demes of this job; retry if a process dies meanwhile."""
        self.dispatch.changed(self.job, "preparing")
        why, fresh = {"do": "restart"} if number > 0 else {}, False
        while True:
            first = Epoch(number, file, self.dispatch.wire(self.nodes, file.run.topology, fresh), why=why)
            try:
                if not self._checked:  # the spy first, so that a wrong problem is found before a thousand nodes read it
                    self._prepare_the_spy(first)
                self._prepare(first, with_the_spy=self._checked)
                self._let_the_spy_listen(first)
                self._begin(first)
                self._lived_before = self.epochs.since
                return
            except ReplacedError:
                fresh = True  # the new process has no links, so the existing wiring is no longer shared by all

    def _stop_in_the_queue(self) -> StopRequest:
        """Return the stop request that ended a job before it got nodes.

        The dispatcher puts a stop request or a failure into the queue before it starts a conductor without nodes, so
        this does not wait for ever.
        """
        while not isinstance(message := self.calls.next(), StopRequest):
            pass  # such as a change of a job that will never run: `Job.update` sees that the job has ended
        return message

    def _take_over(self, placement: Placement) -> None:
        """Continue a job that the previous coordinator left running; begin it again if none of its nodes is left."""
        # The wiring's number is enough: nodes that have its links keep them.
        epoch = Epoch(placement.epoch, placement.file, Wiring(placement.wiring, placement.nodes), why=placement.why)
        self.epochs.take_over(epoch)
        self.best = self._answer_for(epoch)
        epoch.dead = set(range(epoch.cells)) - self._present_cells(epoch)
        self._spy_is_new = True  # it may have been replaced while there was no coordinator
        self._replace_the_dead()
        if self.epoch is epoch:  # else a new epoch has begun without the dead, and reports are asked for already
            for each in self.epochs.unsettled:
                self._ask_for_reports(each)
            if epoch.number > 0:  # the previous coordinator may have died between `_begin` and `_stop`
                self._stop_everywhere(epoch.number - 1, "update")

    def _present_cells(self, epoch: Epoch) -> set[int]:
        """Return the cells whose nodes hold this job; allow a second for nodes that still look for the router."""
        until = time.monotonic() + _FOUND_WITHIN
        while True:
            with contextlib.suppress(ReplacedError):
                answers = self.calls.ask([(self.keys.every_control, Look(self.number))], 0, give_up=False)
                looks = [json.loads(answer.note) for answer in answers if isinstance(answer, Done)]
                self.versions = looks[0]["versions"] if looks else {}
                there = {look["cell"] for look in looks}
                if len(there) == epoch.cells or time.monotonic() >= until:
                    return there
                self.calls.wait(ASK_AGAIN)

    def _start_over(self) -> None:
        """Begin the job again with new individuals, in the latest problem: no node is left that has its demes."""
        self.dispatch.changed(self.job, "queued")
        self._set_out(self.epoch.number + 1, self.epoch.file)
        self._unsent_stop = self._stop_request  # what was sent of it is lost with the nodes

    def _prepare(self, epoch: Epoch, demes: dict[int, bytes] | None = None, *, with_the_spy: bool = False) -> None:
        """Prepare every node for an epoch, and the spy too if ``with_the_spy``.

        Args:
            epoch: the epoch to prepare.
            demes: by cell, the individuals for new nodes, which have none. Not None only after a death; then each node
                gets a command of its own, else one command reaches all of them.
            with_the_spy: whether to ask the spy at the same time.

        Raises:
            ClusterFailed: if the nodes' versions differ so that a lockstep run could not be repeated.
        """
        wiring = epoch.wiring
        if demes is None:
            # None: each node fills in its own count, since the current epoch still runs and nobody knows its end yet.
            since = epoch.since if epoch.is_fresh else None
            questions = [(self.keys.every_control, self._preparation(epoch, since))]
        else:
            questions = [
                (self.keys.control(node), self._preparation(epoch, epoch.since, demes.get(cell, b"")))
                for cell, node in enumerate(wiring.nodes)
            ]
        if with_the_spy:
            questions.append((self.keys.spy_control, self._preparation_of_the_spy(epoch)))
        answers = self.calls.ask(questions, epoch.cells + with_the_spy, give_up=not self.epochs)
        # Each node answers with its fingerprint: versions and processor. The spy's answer has an empty note.
        fingerprints = {answer.note for answer in answers if isinstance(answer, Done)} - {Done().note}
        if epoch.file.run.mode == "lockstep" and len(fingerprints) > 1:
            raise ClusterFailed(
                f"expected equal versions on all nodes in lockstep, found {' / '.join(sorted(fingerprints))}"
            )
        self.versions = json.loads(min(fingerprints))

    def _preparation(self, epoch: Epoch, since: int | None = None, deme: bytes = b"") -> Prepare:
        place = self.number, epoch.number, epoch.file.to_json(), epoch.wiring
        return Prepare(*place, since, deme, cluster_nodes=self.dispatch.cluster_nodes, fresh=epoch.is_fresh)

    def _preparation_of_the_spy(self, epoch: Epoch) -> Prepare:
        best = self._answer_for(epoch)
        encoded = b"" if best is None else best.encode()
        return replace(self._preparation(epoch), best=encoded)

    def _show_to_the_spy(self, epoch: Epoch) -> None:
        """Prepare the spy for an epoch and link it with the root. Only after `_prepare`: the root may get new links."""
        self._prepare_the_spy(epoch)
        self._let_the_spy_listen(epoch)

    def _prepare_the_spy(self, epoch: Epoch) -> None:
        self.calls.ask([(self.keys.spy_control, self._preparation_of_the_spy(epoch))], give_up=not self.epochs)

    def _let_the_spy_listen(self, epoch: Epoch) -> None:
        self.calls.ask([(self.keys.spy_control, Begin(self.number, epoch.number))], give_up=not self.epochs)

    def _begin(self, epoch: Epoch) -> None:
        """Make ``epoch`` the latest and let each node begin it once its cell has stopped in the previous one."""
        self._pass_on_histories()
        with self._improving:  # `improve` compares with the epoch and the best answer: both change at once
            before, self.best = self.best, self._answer_for(epoch)
            self.epochs.add(epoch)
        placement = Placement(epoch.number, epoch.file, self.nodes, epoch.wiring.number, epoch.why, self.epochs.past)
        self.dispatch.changed(self.job, epoch.state)
        # Both are in the store when `placed` returns (unless the database is away for long), and nodes begin only after
        # that. So a coordinator that takes over does not meet nodes in a later epoch than the store knows of.
        self.dispatch.placed(self.job, placement)
        self.job.log.start(self.number, epoch.number, epoch.file.run)
        if self.best is not None and self.best is not before:  # no node has begun, so `improve` cannot interfere
            self._tell(self.best)
        self._ask_for_reports(epoch)
        self._oracle.turn_to(epoch.file)

    def _ask_for_reports(self, epoch: Epoch) -> None:
        """Ask every cell to report when it stops. Harmless for cells that run or have stopped: `Begin` is idempotent.

        Needed again after the death of the coordinator that asked before, or of the router that carried the question.
        """
        epoch.asked = self.calls.ask_for_reports(self.keys.every_control, Begin(self.number, epoch.number))

    # While it runs ----------------------------------------------------------------------------------------------------
    def _live(self) -> Judgement:
        """Conduct until the latest epoch has stopped; return its judgement.

        Stop requests, changes and deaths are dealt with meanwhile, so the latest epoch may be another one in the end.
        """
        while True:
            try:
                error = self._gather()
                return self._finish(error)
            except ReplacedError as replaced:
                self._mark_dead(replaced.node)
                self._replace_the_dead()

    def _gather(self) -> str | None:
        """Wait for the report of every cell; return the message of the first that failed, without waiting for others.

        Raises:
            ReplacedError: if a process died and was replaced meanwhile.
            ClusterFailed: if the job cannot continue.
        """
        while self.epochs.unsettled:
            if self.epochs.settled:  # all cells are in the latest epoch, so stops and changes can be sent now
                self._send_what_was_put_off()
            message = self.calls.next(_sooner(self._ask_at, self._oracle.look_at))
            if message is None:
                self._look_at_the_clock()
            elif isinstance(message, Reported):
                if message.report is None:
                    # The question has ended without all reports: its time was over, or the router died. Ask again,
                    # unless it has been asked again already.
                    is_latest = any(message.question == epoch.asked for epoch in self.epochs.unsettled)
                    self._ask_at = time.monotonic() + ASK_AGAIN if is_latest else self._ask_at
                elif (error := self._note(message.epoch, message.report)) is not None:
                    return error
            else:
                self._attend_to(message)
        return None

    def _look_at_the_clock(self) -> None:
        """Ask for reports again if that is due, and look whether the oracle has answered."""
        if self._ask_at is not None and time.monotonic() >= self._ask_at:
            self._ask_at = None
            self._ask_again()
        self._oracle.look()
        if self._oracle.is_hopeless and self._stop_request is None:
            self._attend_to(StopRequest("infeasible"))

    def _with_the_oracle(self, judgement: Judgement) -> Judgement:
        """Return the judgement, completed by the oracle's answer if the run has stalled for good or is infeasible.

        This waits for an oracle that still works (for a limited time, see `Consulting`), unless the job is stopped or
        the cluster fails meanwhile.
        """
        if not judgement.is_open:
            return judgement
        self._oracle.ask()
        with contextlib.suppress(ClusterFailed):
            while (look_at := self._oracle.look_at) is not None:
                if isinstance(self.calls.next(look_at), StopRequest):
                    break
                self._oracle.look()
        bounds = self._oracle.bounds
        if bounds is None:
            return judgement
        self.job.log.write("oracle", says=bounds.words)
        return judgement.with_oracle(bounds)

    def _ask_again(self) -> None:
        """Ask for reports again and repeat the stops, which a dead router may have lost; both are idempotent."""
        for epoch in self.epochs.unsettled:
            self._ask_for_reports(epoch)
            if epoch is not self.epoch:
                self._stop_everywhere(epoch.number, "update")
        self._unsent_stop = self._stop_request

    def _send_what_was_put_off(self) -> None:
        """Send a stop or begin a change that came while cells were still moving to the latest epoch.

        A cell that has not begun the latest epoch would ignore a stop in it, and there cannot be three epochs at once.
        """
        if self._unsent_stop is not None:
            self._stop(self.epoch.number, self._unsent_stop.reason)
            self._unsent_stop = None
        if self._changes:  # one at a time: then the cells are on their way again
            self._change(self._changes.popleft())

    def _note(self, number: int, report: Report) -> str | None:
        """Note the report of a cell that has stopped in epoch ``number``; return its message if the cell failed."""
        epoch = self.epochs.of(number)
        if epoch is not None:  # reports may come twice, or of an epoch that is summed up already
            epoch.reports[report.cell] = report
            if epoch.file.run.mode == "async" and report.proposals and not epoch.rescued:
                # Async nodes may lose messages, the one that carries the stop too: a cell could miss it and never end.
                self._stop_everywhere(number, report.proposals[0].reason)
        return report.error

    def _attend_to(self, message: object) -> None:
        """Note a request; it is carried out by `_send_what_was_put_off` when the cells are ready for it.

        Raises:
            ReplacedError: if the message is that a process was replaced.
        """
        if isinstance(message, StopRequest):
            self._stop_request = self._stop_request or message
            self._unsent_stop = message
        elif isinstance(message, Replaced):
            raise ReplacedError(message)
        elif isinstance(message, Change):
            self._changes.append(message)

    def _stop(self, number: int, reason: Reason) -> None:
        """Propose a stop in an epoch: in lockstep to the root only, in async mode to all cells.

        In lockstep the root's proposal travels with its emigrants, and all cells stop after the same generation. In
        async mode each cell stops when the proposal arrives, and the root may have ended before the others.
        """
        epoch = self.epochs.of(number)
        if epoch is None or epoch.file.run.mode == "async":
            self._stop_everywhere(number, reason)
        else:
            self.calls.tell(self.keys.control(self.nodes[ROOT]), ProposeStop(self.number, number, reason))

    def _stop_everywhere(self, number: int, reason: Reason) -> None:
        if (epoch := self.epochs.of(number)) is not None:
            epoch.rescued = True
        self.calls.tell(self.keys.every_control, ProposeStop(self.number, number, reason))

    def _finish(self, error: str | None) -> Judgement:
        """Have the spy judge the epoch that has stopped.

        Args:
            error: why a cell failed, if one did.

        Raises:
            ClusterFailed: if the spy does not answer as it should.
            ReplacedError: if the spy died; the caller prepares the new one and tries again.
        """
        self._pass_on_histories()
        past, lived = self.epochs.whole()
        epoch, reports = self.epoch, lived.reports
        command = Finish(
            self.number,
            epoch.number,
            past.or_better(lived),
            stopped_after(reports) if reports else 0,
            stop_reasons(reports, epoch.file.run.mode),
            error,
            tuple(states_of(reports).items()),
            self.epochs.since - self._lived_before,
        )
        (answer,) = self.calls.ask([(self.keys.spy_control, command)], give_up=False)
        if not isinstance(answer, Judged):
            raise ClusterFailed("the spy did not judge the run")
        judgement = Judgement.of(answer)
        if judgement.best is not None:
            self.improve(judgement.best)  # the spy has published it, but that message may still be on its way
        self.job.log.end(judgement, command.generation)
        return judgement

    # From one epoch to the next ---------------------------------------------------------------------------------------
    def _change(self, change: Change) -> None:
        """Begin another epoch as requested; if that is impossible, answer why and stay in the current one.

        Raises:
            ReplacedError: if a process died meanwhile; the change stays first in line.
        """
        try:
            self._begin_another(change)
        except ReplacedError:
            self._changes.appendleft(change)  # it is tried again once the dead are replaced
            raise

    def _begin_another(self, change: Change) -> None:
        """Prepare the next epoch, begin it, then stop the current one.

        In this order the nodes breed in the current epoch until all of them are prepared for the next one.
        """
        before = self.epoch
        try:
            if self._stop_request is not None:
                raise ClusterFailed(f"job {self.job.spec.job} is being stopped")
            file = before.file.changed(change.fields, change.run)
            if file.sha256 == before.file.sha256 and file.run == before.file.run:
                change.answer.put(before.number)  # a client may repeat a request whose answer it did not get
                return
            same_cells = topologies.parse(file.run.topology).cells == before.cells
            if not same_cells:
                raise BadInput(f"topology: expected one of {before.cells} cells, found {file.run.topology!r}")
            wiring = self.dispatch.wire(self.nodes, file.run.topology)
            epoch = Epoch(before.number + 1, file, wiring, why=_directive(change))
            with blaming_the_update(bool(change.fields)):
                self._prepare(epoch)
        except (GivenUpError, ReplacedError):
            raise
        except Exception as error:  # nothing has begun yet, so the current epoch continues whatever is wrong
            change.answer.put(error)
            return
        self._show_to_the_spy(epoch)
        self._begin(epoch)
        self._stop(before.number, "update")
        change.answer.put(epoch.number)

    def _try_again(self, judgement: Judgement) -> None:
        """Begin another attempt, with new individuals, after an epoch that has stalled without an answer.

        Raises:
            ClusterFailed: if the problem's ``next_attempt`` returned fields that make no valid problem.
        """
        before, best, fields = self.epoch, judgement.best, judgement.next_attempt or {}
        if best is not None and best.epoch == before.number:
            self.improve(best)
            self.best = best  # the judged one: its solution includes what cells reported of their states
        try:
            file, fresh = before.file.next_attempt(fields), False
        except BadInput as error:
            raise ClusterFailed(str(error)) from error
        why = retry(file, before.number + 1, fields)
        since = self._lived(before, halted=False)
        while True:
            wiring = self.dispatch.wire(self.nodes, file.run.topology, fresh)
            epoch = Epoch(before.number + 1, file, wiring, since, why=why)
            try:
                self._prepare(epoch)
                self._show_to_the_spy(epoch)
                self.job.tell(BegunAnew(why))
                return self._begin(epoch)
            except ReplacedError:
                fresh = True  # the new node needs links, but no deme: all cells draw new individuals
            except BadInput as error:
                raise ClusterFailed(str(error)) from error

    def _wait_for_a_change(self) -> bool:
        """Wait, in a job that is kept alive, for a change that begins another epoch; return False if it is stopped.

        The cells have stopped meanwhile, but keep their demes.
        """
        self.dispatch.changed(self.job, "waiting")
        number = self.epoch.number
        while self.epoch.number == number:
            message = self._changes.popleft() if self._changes else self.calls.next()
            try:
                if isinstance(message, StopRequest):
                    self._stop_request = message
                    return False
                if isinstance(message, Change):
                    self._change(message)
                elif isinstance(message, Replaced):
                    raise ReplacedError(message)
            except ReplacedError as replaced:
                self._mark_dead(replaced.node)
                self._replace_the_dead()
        return True

    def _ended_as_requested(self, judgement: Judgement) -> Judgement:
        """Return the judgement with the status of the stop request, for a job that would have continued without it."""
        assert self._stop_request is not None
        return replace(judgement, status=STATUS_OF[self._stop_request.reason], next_attempt=None)

    def _mark_dead(self, node: int | None) -> None:
        """Note that a node of this job (None: the spy) was replaced by a new process, which knows nothing of the job.

        Once all cells have reported, a dead node matters only if the job is kept alive: its deme may be needed then.
        """
        if node is None:
            self._spy_is_new = True
        elif node in self.nodes and (self.epoch.file.run.keep_alive or not self.epoch.stopped):
            self.epoch.dead.add(self.nodes.index(node))

    def _replace_the_dead(self) -> None:
        """Bring the new processes into the job; repeat if another one dies meanwhile."""
        while self._spy_is_new or self.epoch.dead:
            try:
                if self.epoch.dead:  # this begins a new epoch, which is shown to a new spy too
                    self._go_on_without_the_dead()
                else:
                    self._show_to_the_spy(self.epoch)
                self._spy_is_new = False
            except ReplacedError as another:
                self._mark_dead(another.node)

    def _go_on_without_the_dead(self) -> None:
        """Halt the other cells and begin an epoch in which each new node starts with the deme of a neighbour.

        The others continue with their own demes. In lockstep a cell advances only with its neighbours' messages, so the
        halted cells differ by at most as many generations as there are links between them and a dead cell.
        """
        before = self.epoch
        others = set(range(before.cells)) - before.dead
        if not others:
            return self._start_over()
        self._wait_until_halted(before, others)
        # A node may have died after its cell had reported. The directive must not list that cell among the others.
        before.reports = {cell: report for cell, report in before.reports.items() if cell in others}
        return self._begin_with_new_nodes(before)

    def _wait_until_halted(self, epoch: Epoch, others: set[int]) -> None:
        """Halt the cells and wait for the reports of ``others``; other messages are put back for later.

        Raises:
            ReplacedError: if another process dies meanwhile.
            ClusterFailed: if a cell fails, or they take too long.
        """
        until, again = time.monotonic() + _HALTED_WITHIN, 0.0  # `again`: when to send the command (0.0: now)
        aside = []
        try:
            while not others <= epoch.reports.keys():
                now = time.monotonic()
                if now >= until:
                    raise ClusterFailed("the cells did not halt after a node had died")
                if now >= again:
                    self._halt()
                    again = until
                message = self.calls.next(again)
                if isinstance(message, Replaced):
                    raise ReplacedError(message)
                if not isinstance(message, Reported):
                    aside.append(message)
                elif message.report is None:
                    again = min(again, time.monotonic() + ASK_AGAIN)
                elif (error := self._note(message.epoch, message.report)) is not None:
                    raise ClusterFailed(error)
        finally:
            for message in aside:
                self.calls.put_off(message)

    def _halt(self) -> None:
        """Halt the cells in whichever epoch they are.

        Each `Halt` follows a `Begin`: a cell that missed the first `Begin` has to begin the latest epoch to halt in it.
        """
        for epoch in self.epochs.known:
            self._ask_for_reports(epoch)
            self.calls.ask_for_reports(self.keys.every_control, Halt(self.number, epoch.number))

    def _begin_with_new_nodes(self, before: Epoch) -> None:
        """Begin the epoch after a death; its directive says everything that a replay needs to repeat it."""
        topology = topologies.parse(before.file.run.topology)
        donors = {cell: _deme_donor(topology.neighbours(cell), before) for cell in sorted(before.dead)}
        reached = {str(cell): report.generation for cell, report in sorted(before.reports.items())}
        why = {
            "do": "replace",
            "demes_of": {str(cell): donor for cell, donor in donors.items()},
            "generations": reached,
        }
        wiring = self.dispatch.wire(self.nodes, topology.spec, fresh=True)
        since = self._lived(before, halted=True)
        epoch = Epoch(before.number + 1, before.file, wiring, since, why=why)
        self._prepare(epoch, {cell: before.reports[donor].deme for cell, donor in donors.items()})
        self._show_to_the_spy(epoch)
        self._begin(epoch)
        self._unsent_stop = self._stop_request  # a stop in the halted epoch does not hold in this one

    def _lived(self, latest: Epoch, halted: bool) -> int:
        """Return the generations up to the end of the latest epoch, counted from where the job last began with nothing.

        A limit of generations counts only these: of a job whose nodes all died the earlier ones are lost.
        """
        return self.epochs.since + lived_for(list(latest.reports.values()), halted) - self._lived_before

    def _drop(self) -> None:
        """Let nodes and spy forget the job."""
        with contextlib.suppress(zenoh.ZError):  # the session may be closed; then the processes end anyway
            self.calls.tell(self.keys.every_control, Drop(self.number))
            self.calls.tell(self.keys.spy_control, Drop(self.number))


def _sooner(*times: float | None) -> float | None:
    """Return the earliest of the given times; None if there is none."""
    return min((each for each in times if each is not None), default=None)


def _deme_donor(slots: tuple[int, ...], epoch: Epoch) -> int:
    """Return the first neighbour that has reported; if none has, the first cell that has."""
    return next(cell for cell in (*slots, *sorted(epoch.reports)) if cell in epoch.reports)


def _directive(change: Change) -> dict[str, object]:
    """Return the directive of a change, by which a simulation repeats it."""
    if change.run:
        return {"do": "rewire", **change.run}
    return {"do": "update", "fields": change.fields}
