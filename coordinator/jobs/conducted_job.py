"""A job that is conducted: what its conductor knows of it, in all states of the job."""

import threading
from collections import deque
from collections.abc import Sequence
from typing import NoReturn, Protocol

from coordinator.jobs.calls import Calls, GivenUpError
from coordinator.jobs.consulting import Consulting
from coordinator.jobs.epochs import Epoch, Epochs
from coordinator.jobs.job import Change, JobEntry, Placement, StopRequest
from spy.improvement_records import ImprovementRecord, records_of
from spy.past import Past, lived_for
from topologies import ROOT
from wire.control import Begin, ProposeStop, Wiring
from wire.keys import Keys
from wire.news import Improvement
from wire.report import Reason, Report


class ConductorServices(Protocol):
    """The services of a dispatcher that a conductor uses; called on the conductor's thread and on Zenoh's."""

    @property
    def cluster_nodes(self) -> int:
        """The number of nodes in the cluster, busy or free."""

    def wire(self, nodes: tuple[int, ...], topology: str, fresh: bool = False) -> Wiring:
        """Return the links for an epoch: the existing ones if all its nodes share them, else (or if ``fresh``) new."""

    def hosts_of(self, nodes: tuple[int, ...]) -> tuple[str, ...]:
        """Return the host of each of these nodes; empty if one zygote launched them all."""

    def wiring_of(self, number: int, nodes: tuple[int, ...]) -> Wiring:
        """Return the links of that number between these nodes, which a coordinator before this one has made."""

    def open_links(self, node: int, wirings: Sequence[int]) -> None:
        """Note the wirings whose links a node has, which a coordinator before this one has made."""

    def end_silent(self, nodes: Sequence[int], seconds: float) -> None:
        """End the processes of those nodes that have told nothing for so long, where that is possible."""

    def changed(self, job: JobEntry, status: str) -> None:
        """Record that the job has entered another state."""

    def placed(self, job: JobEntry, placement: Placement) -> None:
        """Record that the job is about to begin this epoch."""

    def improved(self, job: JobEntry, better: Improvement) -> None:
        """Record a better answer."""

    def lived(self, job: JobEntry, epoch: int, records: Sequence[ImprovementRecord]) -> None:
        """Record the improvements of an epoch that has ended."""


class ConductedJob:
    """One job, as the classes know it that conduct it through its states.

    Threads: Zenoh's network thread calls only `improve`, which takes a lock. The conductor's thread alone touches
    everything else.

    Args:
        entry: the job as its submitter sees it; its queue is the conductor's mailbox.
        calls: sends commands, and reads the queue.
        keys: the key expressions of the cluster.
        nodes: the nodes of the job, in the order of its cells; empty if it must end without ever having run.
        dispatch: the dispatcher that runs the conductor.
        adopted: the state of the job, if it was running when the previous coordinator died.

    Attributes:
        epochs: its epochs so far.
        best: the best answer so far to the problem of the latest epoch.
        versions: the versions of the software on the nodes.
        oracle: asks the problem's oracle.
        lived_before: generations of the job when it last began with new demes.
        stop_request: the first one; later ones do not change the job's status.
        unsent_stop: a stop that must still be sent to the cells of the latest epoch.
        changes: requested, but not begun.
        checkpoint: the latest one; None if there is none.
    """

    def __init__(
        self,
        entry: JobEntry,
        calls: Calls,
        keys: Keys,
        nodes: tuple[int, ...],
        dispatch: ConductorServices,
        adopted: Placement | None,
    ) -> None:
        self.entry = entry
        self.number = entry.spec.number
        self.calls = calls
        self.keys = keys
        self.nodes = nodes
        self.dispatch = dispatch
        self.epochs = Epochs(entry.spec.past if adopted is None else adopted.past)
        self.best = entry.spec.best if adopted is None else adopted.best
        self.versions: dict[str, str] = {}
        self.oracle = Consulting()
        self.lived_before = 0
        self.stop_request: StopRequest | None = None
        self.unsent_stop: StopRequest | None = None
        self.changes: deque[Change] = deque()
        self.checkpoint = entry.spec.checkpoint
        self._improving = threading.Lock()

    @property
    def epoch(self) -> Epoch:
        """The latest epoch."""
        return self.epochs.latest

    def improve(self, better: Improvement) -> None:
        """Publish an answer if it is better than the best known one; ignore it otherwise. Thread-safe.

        Answers of an earlier epoch are ignored too: they may solve another problem, or may still be on their way when
        the next epoch has begun.
        """
        with self._improving:
            now = bool(self.epochs) and better.epoch == self.epoch.number
            if now and (self.best is None or better.fitness < self.best.fitness):
                self.publish(better)

    def publish(self, better: Improvement) -> None:
        """Make an answer the best one; pass it on to the run log, the reader and the dispatcher."""
        self.best = better
        self.entry.log.news(self.epoch.topology, better)
        self.entry.tell(better)
        self.dispatch.improved(self.entry, better)

    def enter(self, epoch: Epoch) -> Improvement | None:
        """Make ``epoch`` the latest; return the best answer if it was carried to that, so that it must be published."""
        with self._improving:  # `improve` compares with the epoch and the best answer: both change at once
            before, self.best = self.best, self.answer_for(epoch)
            self.epochs.add(epoch)
            return None if self.best is before else self.best

    def go_back_to(self, past: Past) -> None:
        """Forget the epochs after a past: none of their cells is at work."""
        with self._improving:
            self.epochs.past, self.epochs.known = past, []

    def answer_for(self, epoch: Epoch) -> Improvement | None:
        """Return the best answer so far if it is still an answer to the problem of ``epoch``; else None.

        An update changes the problem, so older answers no longer count. After a retry the answer keeps the epoch that
        it was found in: the new attempt has not found it.
        """
        best, do = self.best, epoch.why.get("do")
        if best is None or (best.epoch < epoch.number and do == "update"):
            return None
        return best if do == "retry" else best.carried_to(epoch.number)

    def give_up(self, stop: StopRequest, seconds: float) -> NoReturn:
        """End the processes whose cells have told nothing for so many seconds since a stop.

        Raises:
            GivenUpError: always.
        """
        self.dispatch.end_silent(self.nodes, seconds)
        raise GivenUpError(stop)

    def pass_on_histories(self) -> None:
        """Report the improvements of epochs that have ended; called before each new epoch and at the end of the job."""
        for past, epoch in self.epochs.not_passed_on():
            records = records_of(past, epoch.lived)
            self.entry.note(epoch.topology, records)
            self.dispatch.lived(self.entry, epoch.number, records)

    def generations(self, latest: Epoch, halted: bool) -> int:
        """Return the generations up to the end of the latest epoch, counted from where the job last began with nothing.

        A limit of generations counts only these: of a job whose nodes all died the earlier ones are lost.
        """
        return self.epochs.since + lived_for(list(latest.reports.values()), halted) - self.lived_before

    def ask_for_reports(self, epoch: Epoch) -> None:
        """Ask every cell to report when it stops. Harmless for cells that run or have stopped: `Begin` is idempotent.

        Needed again after the death of the coordinator that asked before, or of the router that carried the question.
        """
        command = Begin(self.number, epoch.number, epoch.wiring_number)
        epoch.asked = self.calls.ask_for_reports(self.keys.every_control, command)

    def note(self, number: int, report: Report) -> str | None:
        """Note the report of a cell that has stopped in epoch ``number``; return its message if the cell failed."""
        epoch = self.epochs.of(number)
        if epoch is not None:  # reports may come twice, or of an epoch that is summed up already
            epoch.reports[report.cell] = report
            if epoch.file.run.mode == "async" and report.proposals and not epoch.rescued:
                # Async nodes may lose messages, the one that carries the stop too: a cell could miss it and never end.
                self.stop_everywhere(number, report.proposals[0].reason)
        return report.error

    def stop(self, number: int, reason: Reason) -> None:
        """Propose a stop in an epoch: in lockstep to the root only, in async mode to all cells.

        In lockstep the root's proposal travels with its emigrants, and all cells stop after the same generation. In
        async mode each cell stops when the proposal arrives, and the root may have ended before the others.
        """
        epoch = self.epochs.of(number)
        if epoch is None or epoch.file.run.mode == "async":
            self.stop_everywhere(number, reason)
        else:
            self.calls.tell(self.keys.control(self.nodes[ROOT]), ProposeStop(self.number, number, reason))

    def stop_everywhere(self, number: int, reason: Reason) -> None:
        """Propose a stop in an epoch to all cells."""
        if (epoch := self.epochs.of(number)) is not None:
            epoch.rescued = True
        self.calls.tell(self.keys.every_control, ProposeStop(self.number, number, reason))
