"""The coordinator's part in one job: prepare all, start all, pass stop requests on, gather reports, have them verified.

A job lives in a row of epochs. An update, another topology and the replacement of a dead node are one and the same: the
next epoch is prepared and begun everywhere, the one before is stopped, and each node goes on in the next with the deme
that it has.
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

_FOUND_WITHIN = 1.0  # seconds: nodes that live find a new router in a fifth of it
_HALTED_WITHIN = 60.0  # seconds
_LASTING = ("solved", "stalled")  # how a search can end that may go on, by another attempt or in another epoch


class Dispatch(Protocol):
    """What a conductor needs of whoever runs it; called on the conductor's thread, and by Zenoh's."""

    @property
    def cluster_nodes(self) -> int:
        """How many nodes there are, at any job or at none."""

    def wire(self, nodes: tuple[int, ...], topology: str, fresh: bool = False) -> Wiring:
        """The links for an epoch: those that all its nodes have, or (``fresh``: always) new ones."""

    def changed(self, job: JobEntry, status: str) -> None:
        """The job is in another state."""

    def placed(self, job: JobEntry, placement: Placement) -> None:
        """The job is about to begin in this epoch."""

    def improved(self, job: JobEntry, better: Improvement) -> None:
        """There is a better answer."""

    def lived(self, job: JobEntry, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """An epoch of the job has ended, in which there were these improvements."""


class Conductor:
    """Conducts one job on ``nodes``; without any, it has only its queue to read, and ends by that.

    Args:
        replaces: whether dead processes are replaced.
        adopted: where the job is, if it was running when the coordinator before this one died.
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
        self._checked = replaces  # the request handler of a cluster that stays up has done so
        self._spy_is_new = False
        self._lived_before = 0  # generations, when it last began with new demes: their limit counts from there
        self._stop_request: StopRequest | None = None
        self._changes: deque[Change] = deque()
        self._unheard: StopRequest | None = None  # what the cells have still to be told
        self._ask_at: float | None = None  # when to ask for reports again, whatever dies meanwhile
        self._oracle = Consulting()

    @property
    def epoch(self) -> Epoch:
        """The latest."""
        return self.epochs.latest

    def conduct(self, seconds_to_ready: float, cpu_seconds: Callable[[], dict[str, float]]) -> Result:
        """Run the job to its end.

        Raises:
            BadInput: if the problem is wrong.
        """
        used = cpu_seconds()
        judgement = self._judgement()
        if judgement.best is not None:
            self.improve(judgement.best)
        spent = sum(after - used[name] for name, after in cpu_seconds().items() if name in used)
        clocks = Clocks(self.seconds, seconds_to_ready, spent)
        spec = self.job.spec
        never_begun = spec.past, Lived(spec.file, number=spec.past.epochs)
        past, epoch = self.epochs.whole() if self.epochs else never_begun
        name = spec.job or str(self.number)
        return result_of(name, spec.first_run or spec.file.run, past, epoch, judgement, self.versions, clocks)

    def improve(self, better: Improvement) -> None:
        """Pass on an improvement, if it is one. Called by Zenoh's thread too."""
        with self._improving:
            now = bool(self.epochs) and better.epoch == self.epoch.number
            if now and (self.best is None or better.fitness < self.best.fitness):
                self._tell(better)

    def _tell(self, better: Improvement) -> None:
        self.best = better
        self.job.log.news(self.epoch.topology, better)
        self.job.tell(better)
        self.dispatch.improved(self.job, better)

    def _tell_what_was_lived(self) -> None:
        """Of epochs that have ended, before there is another one or the end."""
        for past, epoch in self.epochs.untold():
            records = records_of(past, epoch.lived)
            self.job.note(epoch.topology, records)
            self.dispatch.lived(self.job, epoch.number, records)

    def _answer_for(self, epoch: Epoch) -> Improvement | None:
        """The best so far, unless ``epoch`` is another than its own and has another problem than the one before."""
        best, do = self.best, epoch.why.get("do")
        if best is None or (best.epoch < epoch.number and do == "update"):
            return None
        return best if do == "retry" else best.carried_to(epoch.number)

    def _judgement(self) -> Judgement:
        """What came of it, whatever goes wrong."""
        try:
            return self._with_the_oracle(self._run())
        except GivenUpError as error:
            status, best = STATUS_OF[error.stop_request.reason], self.best
            if best is None:
                return Judgement(status, False, "stopped before there was a result", None)
            return Judgement(status, best.feasible, None, best)
        except ClusterFailed as error:
            cancelled = self._stop_request is not None and self._stop_request.reason == "cancel" and self.calls.closing
            return Judgement("cancelled" if cancelled else "failed", False, str(error), self.best)
        except BadInput:
            raise
        except Exception as error:  # whatever it is, whoever waits for this job must hear of its end
            return Judgement("failed", False, f"{type(error).__name__}: {error}", self.best)
        finally:
            self._oracle.close()
            if self.nodes:
                self._drop()

    def _run(self) -> Judgement:
        if not self.nodes:
            raise GivenUpError(self._wish_in_the_queue())
        if self._adopted is None:
            self._set_out(self.epochs.past.epochs, self.job.spec.file)
        else:
            self._take_over(self._adopted)
        began = time.monotonic()
        try:
            while True:
                judgement = self._live()
                seeks, waits = judgement.next_attempt is not None, self.epoch.file.run.keep_alive
                if judgement.status not in _LASTING or not (seeks or waits):
                    return judgement
                if self._stop_request is not None:
                    return self._ended_as_wished(judgement) if seeks else judgement
                if seeks:
                    if judgement.has_oracle:
                        self._oracle.ask()
                    self._try_again(judgement)
                elif not self._wait_for_a_change():
                    return self._ended_as_wished(judgement)
        finally:
            self.seconds = time.monotonic() - began

    # The beginning of a job -------------------------------------------------------------------------------------------
    def _set_out(self, number: int, file: ProblemFile) -> None:
        """Prepare and begin the first epoch; from the start again if a process dies meanwhile."""
        self.dispatch.changed(self.job, "preparing")
        why, fresh = {"do": "restart"} if number > 0 else {}, False
        while True:
            first = Epoch(number, file, self.dispatch.wire(self.nodes, file.run.topology, fresh), why=why)
            try:
                if not self._checked:  # the spy first: it finds a wrong problem before a thousand nodes do
                    self._prepare_the_spy(first)
                self._prepare(first, with_the_spy=self._checked)
                self._let_the_spy_listen(first)
                self._begin(first)
                self._lived_before = self.epochs.since
                return
            except ReplacedError:
                fresh = True

    def _wish_in_the_queue(self) -> StopRequest:
        """A job that never got nodes was given up."""
        while not isinstance(message := self.calls.next(), StopRequest):
            pass
        return message

    def _take_over(self, placement: Placement) -> None:
        """Go on with a job that runs already, unless all its nodes have died too."""
        epoch = Epoch(placement.epoch, placement.file, Wiring(placement.wiring, placement.nodes), why=placement.why)
        self.epochs.take_over(epoch)
        self.best = self._answer_for(epoch)
        epoch.dead = set(range(epoch.cells)) - self._who_is_there(epoch)
        self._spy_is_new = True
        self._replace_the_dead()
        if self.epoch is epoch:
            for each in self.epochs.unsettled:
                self._ask_for_reports(each)
            if epoch.number > 0:  # the coordinator before may not have come to this
                self._stop_everywhere(epoch.number - 1, "update")

    def _who_is_there(self, epoch: Epoch) -> set[int]:
        """The cells whose nodes are at this job; a node that cannot hear yet has a second for it."""
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
        """Nobody is left who knows anything of the job: it begins again, in the world as it is by now."""
        self.dispatch.changed(self.job, "queued")
        self._set_out(self.epoch.number + 1, self.epoch.file)
        self._unheard = self._stop_request

    def _prepare(self, epoch: Epoch, demes: dict[int, bytes] | None = None, *, with_the_spy: bool = False) -> None:
        """Every node gets ready; with the ``demes`` of cells that have none of their own, each is told by itself."""
        wiring = epoch.wiring
        if demes is None:
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
        fingerprints = {answer.note for answer in answers if isinstance(answer, Done)} - {Done().note}
        if epoch.file.run.mode == "lockstep" and len(fingerprints) > 1:
            raise ClusterFailed(f"nodes differ, lockstep would not repeat: {' / '.join(sorted(fingerprints))}")
        self.versions = json.loads(min(fingerprints))

    def _preparation(self, epoch: Epoch, since: int | None = None, deme: bytes = b"") -> Prepare:
        place = self.number, epoch.number, epoch.file.to_json(), epoch.wiring
        return Prepare(*place, since, deme, cluster_nodes=self.dispatch.cluster_nodes, fresh=epoch.is_fresh)

    def _preparation_of_the_spy(self, epoch: Epoch) -> Prepare:
        best = self._answer_for(epoch)
        encoded = b"" if best is None else best.encode()
        return replace(self._preparation(epoch), best=encoded)

    def _show_to_the_spy(self, epoch: Epoch) -> None:
        """It forgets the epoch before, and listens to the root, whose links are those of this epoch by now."""
        self._prepare_the_spy(epoch)
        self._let_the_spy_listen(epoch)

    def _prepare_the_spy(self, epoch: Epoch) -> None:
        self.calls.ask([(self.keys.spy_control, self._preparation_of_the_spy(epoch))], give_up=not self.epochs)

    def _let_the_spy_listen(self, epoch: Epoch) -> None:
        self.calls.ask([(self.keys.spy_control, Begin(self.number, epoch.number))], give_up=not self.epochs)

    def _begin(self, epoch: Epoch) -> None:
        """Go, as soon as the epoch before has stopped."""
        self._tell_what_was_lived()
        with self._improving:
            before, self.best = self.best, self._answer_for(epoch)
            self.epochs.add(epoch)
        placement = Placement(epoch.number, epoch.file, self.nodes, epoch.wiring.number, epoch.why, self.epochs.past)
        self.dispatch.changed(self.job, epoch.state)
        self.dispatch.placed(self.job, placement)  # both are written now: whoever takes over goes on from here
        self.job.log.start(self.number, epoch.number, epoch.file.run)
        if self.best is not None and self.best is not before:  # nodes have not begun, so there is none but this one
            self._tell(self.best)
        self._ask_for_reports(epoch)
        self._oracle.turn_to(epoch.file)

    def _ask_for_reports(self, epoch: Epoch) -> None:
        """Also of cells that run, or have stopped: who asked before may have died, or the router on the way back."""
        epoch.asked = self.calls.ask_for_reports(self.keys.every_control, Begin(self.number, epoch.number))

    # While it runs ----------------------------------------------------------------------------------------------------
    def _live(self) -> Judgement:
        """Until the latest epoch has stopped, passing on stop requests, changes and the deadline; what came of it."""
        while True:
            try:
                error = self._gather()
                return self._finish(error)
            except ReplacedError as replaced:
                self._mark_dead(replaced.node)
                self._replace_the_dead()

    def _gather(self) -> str | None:
        """Wait for the report of every cell. Returns why one failed, if it did; others are not waited for then."""
        while self.epochs.unsettled:
            if self.epochs.settled:
                self._do_what_was_put_off()
            message = self.calls.next(_sooner(self._ask_at, self._oracle.look_at))
            if message is None:
                self._look_at_the_clock()
            elif isinstance(message, Reported):
                if message.report is None:  # a question ends early when the router dies
                    is_latest = any(message.question == epoch.asked for epoch in self.epochs.unsettled)
                    self._ask_at = time.monotonic() + ASK_AGAIN if is_latest else self._ask_at
                elif (error := self._note(message.epoch, message.report)) is not None:
                    return error
            else:
                self._attend_to(message)
        return None

    def _look_at_the_clock(self) -> None:
        """Do what is due: ask again for reports, and see what the oracle has to say."""
        if self._ask_at is not None and time.monotonic() >= self._ask_at:
            self._ask_at = None
            self._ask_again()
        self._oracle.look()
        if self._oracle.is_hopeless and self._stop_request is None:
            self._attend_to(StopRequest("infeasible"))

    def _with_the_oracle(self, judgement: Judgement) -> Judgement:
        """The judgement of a run that has stalled for good, or ended as hopeless, with what the oracle says of it.

        If it has not come to an answer yet, this waits for that, unless somebody wants an end, or a process has died.
        """
        if not judgement.is_open:
            return judgement
        self._oracle.ask()
        with contextlib.suppress(ClusterFailed):
            while (look_at := self._oracle.look_at) is not None:
                if isinstance(self.calls.next(look_at), StopRequest):
                    break
                self._oracle.look()
        foretold = self._oracle.foretold
        if foretold is None:
            return judgement
        self.job.log.write("oracle", says=foretold.words)
        return judgement.in_the_light_of(foretold)

    def _ask_again(self) -> None:
        """And tell again what may never have been heard, while there was no router: to stop twice is to stop once."""
        for epoch in self.epochs.unsettled:
            self._ask_for_reports(epoch)
            if epoch is not self.epoch:
                self._stop_everywhere(epoch.number, "update")
        self._unheard = self._stop_request

    def _do_what_was_put_off(self) -> None:
        """While cells were on their way to the latest epoch none could be told to leave it."""
        if self._unheard is not None:
            self._stop(self.epoch.number, self._unheard.reason)
            self._unheard = None
        if self._changes:
            self._change(self._changes.popleft())

    def _note(self, number: int, report: Report) -> str | None:
        """A cell has stopped in one of the epochs; returns why, if it failed."""
        epoch = self.epochs.of(number)
        if epoch is not None:
            epoch.reports[report.cell] = report
            if epoch.file.run.mode == "async" and report.proposals and not epoch.rescued:
                # Without lockstep a lost message could leave a node that never hears of the stop.
                self._stop_everywhere(number, report.proposals[0].reason)
        return report.error

    def _attend_to(self, message: object) -> None:
        if isinstance(message, StopRequest):
            self._stop_request = self._stop_request or message
            self._unheard = message
        elif isinstance(message, Replaced):
            raise ReplacedError(message)
        elif isinstance(message, Change):
            self._changes.append(message)

    def _stop(self, number: int, reason: Reason) -> None:
        """Propose a stop in that epoch: to the root, with which all others stop, or in async mode to all at once.

        There each stops when it hears of it, and the root may have ended before others.
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
        self._tell_what_was_lived()
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
            self.improve(judgement.best)  # its news may still be on their way
        self.job.log.end(judgement, command.generation)
        return judgement

    # From one epoch to the next ---------------------------------------------------------------------------------------
    def _change(self, change: Change) -> None:
        """Go on in another epoch, if there can be such a one; else the old one lasts."""
        try:
            self._begin_another(change)
        except ReplacedError:
            self._changes.appendleft(change)  # once the dead are replaced
            raise

    def _begin_another(self, change: Change) -> None:
        before = self.epoch
        try:
            if self._stop_request is not None:
                raise ClusterFailed(f"job {self.job.spec.job} is being stopped")
            file = before.file.changed(change.fields, change.run)
            if file.sha256 == before.file.sha256 and file.run == before.file.run:
                change.answer.put(before.number)  # as when a client repeats what was carried out already
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
        except Exception as error:  # whatever is wrong with the new world, the old one is as good as before
            change.answer.put(error)
            return
        self._show_to_the_spy(epoch)
        self._begin(epoch)
        self._stop(before.number, "update")
        change.answer.put(epoch.number)

    def _try_again(self, judgement: Judgement) -> None:
        """The epoch has stalled without an answer: begin anew, with new individuals, once all are prepared for it.

        Raises:
            ClusterFailed: if the problem asks for an attempt that cannot be.
        """
        before, best, fields = self.epoch, judgement.best, judgement.next_attempt or {}
        if best is not None and best.epoch == before.number:
            self.improve(best)
            self.best = best  # as it was judged: what the cells had to say of it is in it now
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
                fresh = True
            except BadInput as error:
                raise ClusterFailed(str(error)) from error

    def _wait_for_a_change(self) -> bool:
        """The epoch has stopped, and the job is kept alive; whether it goes on in another one."""
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

    def _ended_as_wished(self, judgement: Judgement) -> Judgement:
        """A job that would have gone on, or stayed, ends as it was told to, with the answer that it had."""
        assert self._stop_request is not None
        return replace(judgement, status=STATUS_OF[self._stop_request.reason], next_attempt=None)

    def _mark_dead(self, node: int | None) -> None:
        """Another process lives in the place of a dead node, or of the spy.

        When all cells have told of their ends, a dead one is missed only if the job lives on.
        """
        if node is None:
            self._spy_is_new = True
        elif node in self.nodes and (self.epoch.file.run.keep_alive or not self.epoch.stopped):
            self.epoch.dead.add(self.nodes.index(node))

    def _replace_the_dead(self) -> None:
        """Go on with those who live in their places, from where the others are."""
        while self._spy_is_new or self.epoch.dead:
            try:
                if self.epoch.dead:
                    self._go_on_without_the_dead()
                else:
                    self._show_to_the_spy(self.epoch)
                self._spy_is_new = False
            except ReplacedError as another:
                self._mark_dead(another.node)

    def _go_on_without_the_dead(self) -> None:
        """All others halt; in a new epoch a new node begins with the deme of a neighbour, and they with theirs.

        They are at most as many generations apart as the dead cells were links away from them.
        """
        before = self.epoch
        others = set(range(before.cells)) - before.dead
        if not others:
            return self._start_over()
        self._wait_until_halted(before, others)
        before.reports = {cell: report for cell, report in before.reports.items() if cell in others}
        return self._begin_with_new_nodes(before)

    def _wait_until_halted(self, epoch: Epoch, others: set[int]) -> None:
        until, again = time.monotonic() + _HALTED_WITHIN, 0.0  # when to tell them again
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
        """The cells, wherever they are; one that has not begun with the latest epoch, since it did not hear, does."""
        for epoch in self.epochs.known:
            self._ask_for_reports(epoch)
            self.calls.ask_for_reports(self.keys.every_control, Halt(self.number, epoch.number))

    def _begin_with_new_nodes(self, before: Epoch) -> None:
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
        self._unheard = self._stop_request

    def _lived(self, latest: Epoch, halted: bool) -> int:
        """Generations to the end of the latest epoch, since it last began with nothing."""
        return self.epochs.since + lived_for(list(latest.reports.values()), halted) - self._lived_before

    def _drop(self) -> None:
        """Let nodes and spy forget the job, if they still can hear."""
        with contextlib.suppress(zenoh.ZError):
            self.calls.tell(self.keys.every_control, Drop(self.number))
            self.calls.tell(self.keys.spy_control, Drop(self.number))


def _sooner(*times: float | None) -> float | None:
    """The first of the times that there are."""
    return min((each for each in times if each is not None), default=None)


def _deme_donor(slots: tuple[int, ...], epoch: Epoch) -> int:
    """The first neighbour that lives; if none does, the first cell that does."""
    return next(cell for cell in (*slots, *sorted(epoch.reports)) if cell in epoch.reports)


def _directive(change: Change) -> dict[str, object]:
    """What a result says of it, so that a simulation can do the same."""
    if change.run:
        return {"do": "rewire", **change.run}
    return {"do": "update", "fields": change.fields}
