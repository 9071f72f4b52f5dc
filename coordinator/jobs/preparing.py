"""Prepare the nodes and the spy of a job for an epoch, and begin it."""

import json
from collections.abc import Mapping
from dataclasses import replace

from coordinator.errors import ClusterFailed
from coordinator.jobs.calls import Given, ReplacedError
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.epochs import Epoch
from coordinator.jobs.job import Placement
from problems import ProblemFile
from wire.control import Begin, Command, Done, Prepare
from wire.takeover import Takeover


class Preparing:
    """Prepares and begins the epochs of a job.

    Args:
        job: the job.
        checked: whether the problem was checked before, so that the spy need not check it before the nodes read it.
    """

    def __init__(self, job: ConductedJob, checked: bool) -> None:
        self._job = job
        self._checked = checked

    def set_out(self, number: int, file: ProblemFile) -> None:
        """Prepare and begin an epoch on nodes that hold no demes of this job; retry if a process dies meanwhile."""
        job = self._job
        job.dispatch.changed(job.entry, "preparing")
        why, fresh = {"do": "restart"} if number > 0 else {}, False
        while True:
            first = Epoch(number, file, job.dispatch.wire(job.nodes, file.run.topology, fresh), why=why)
            try:
                if not self._checked:  # the spy first, so that a wrong problem is found before a thousand nodes read it
                    self._prepare_the_spy(first)
                self.prepare(first, with_the_spy=self._checked)
                self._let_the_spy_listen(first)
                self.begin(first)
                job.lived_before = job.epochs.since
                return
            except ReplacedError:
                fresh = True  # the new process has no links, so the existing wiring is no longer shared by all

    def prepare(self, epoch: Epoch, demes: dict[int, bytes] | None = None, *, with_the_spy: bool = False) -> None:
        """Prepare every node for an epoch, and the spy too if ``with_the_spy``.

        Args:
            epoch: the epoch to prepare.
            demes: by cell, the individuals for new nodes, which have none. Not None only after a death; then each node
                gets a command of its own, else one command reaches all of them.
            with_the_spy: whether to ask the spy at the same time.

        Raises:
            ClusterFailed: if the nodes' versions differ so that a lockstep run could not be repeated.
        """
        keys = self._job.keys
        if demes is None:
            # None: each node fills in its own count, since the current epoch still runs and nobody knows its end yet.
            since = epoch.since if epoch.is_fresh else None
            questions = [(keys.every_control, self._preparation(epoch, since))]
        else:
            questions = [
                (keys.control(node), self._preparation(epoch, epoch.since, demes.get(cell, b"")))
                for cell, node in enumerate(epoch.wiring.nodes)
            ]
        if with_the_spy:
            questions.append((keys.spy_control, self._preparation_of_the_spy(epoch)))
        answers = self._job.calls.ask(
            questions, epoch.cells + with_the_spy, give_up=not self._job.epochs, for_nodes_back=True
        )
        self._note_versions(epoch, answers)

    def _note_versions(self, epoch: Epoch, answers: list[Given]) -> None:
        """Note the versions on the nodes.

        Raises:
            ClusterFailed: if they differ so that a lockstep run could not be repeated.
        """
        # Each node answers with its fingerprint: versions and processor. The spy's answer has an empty note.
        fingerprints = {answer.note for answer in answers if isinstance(answer, Done)} - {Done().note}
        if epoch.file.run.mode == "lockstep" and len(fingerprints) > 1:
            raise ClusterFailed(
                f"expected equal versions on all nodes in lockstep, found {' / '.join(sorted(fingerprints))}"
            )
        self._job.versions = json.loads(min(fingerprints))

    def prepare_again(self, epoch: Epoch, takeovers: Mapping[int, Takeover], demes: Mapping[int, bytes]) -> None:
        """Prepare new processes for an epoch, each to go on from a state of its cell; other cells may be in it already.

        Args:
            epoch: the epoch.
            takeovers: what each of these cells is to go on from.
            demes: by cell, the individuals to begin with if its state is empty; without any it begins with random ones.

        Raises:
            ReplacedError: if another process dies meanwhile.
        """
        job = self._job
        since = job.epochs.since - job.lived_before
        command, nodes, key = self._preparation(epoch, since), epoch.wiring.nodes, job.keys.control
        questions: list[tuple[str, Command]] = []
        for cell, takeover in takeovers.items():
            deme = b"" if takeover.state else demes.get(cell, b"")
            questions.append((key(nodes[cell]), replace(command, takeover=takeover, deme=deme)))
        answers = job.calls.ask(questions, len(questions), give_up=not job.epochs, for_nodes_back=True)
        self._note_versions(epoch, answers)

    def _preparation(self, epoch: Epoch, since: int | None = None, deme: bytes = b"") -> Prepare:
        place = self._job.number, epoch.number, epoch.file.to_json(), epoch.wiring
        cluster_nodes, fresh, anew = self._job.dispatch.cluster_nodes, epoch.is_fresh, epoch.is_restart
        return Prepare(*place, since, deme, cluster_nodes=cluster_nodes, fresh=fresh, anew=anew)

    def _preparation_of_the_spy(self, epoch: Epoch) -> Prepare:
        best = self._job.answer_for(epoch)
        encoded = b"" if best is None else best.encode()
        return replace(self._preparation(epoch), best=encoded)

    def show_to_the_spy(self, epoch: Epoch) -> None:
        """Prepare the spy for an epoch and link it with the root. Only after `prepare`: the root may get new links."""
        self._prepare_the_spy(epoch)
        self._let_the_spy_listen(epoch)

    def _prepare_the_spy(self, epoch: Epoch) -> None:
        self._ask_the_spy(self._preparation_of_the_spy(epoch))

    def _let_the_spy_listen(self, epoch: Epoch) -> None:
        self._ask_the_spy(Begin(self._job.number, epoch.number))

    def _ask_the_spy(self, command: Prepare | Begin) -> None:
        self._job.calls.ask([(self._job.keys.spy_control, command)], give_up=not self._job.epochs)

    def begin(self, epoch: Epoch) -> None:
        """Make ``epoch`` the latest and let each node begin it once its cell has stopped in the previous one."""
        job = self._job
        job.pass_on_histories()
        carried = job.enter(epoch)
        placement = Placement(epoch.number, epoch.file, job.nodes, epoch.wiring.number, epoch.why, job.epochs.past)
        job.dispatch.changed(job.entry, epoch.state)
        # Both are in the store when `placed` returns (unless the database is away for long), and nodes begin only after
        # that. So a coordinator that takes over does not meet nodes in a later epoch than the store knows of.
        job.dispatch.placed(job.entry, placement)
        job.entry.log.start(job.number, epoch.number, epoch.file.run)
        if carried is not None:  # no node has begun, so `improve` cannot interfere
            job.publish(carried)
        job.ask_for_reports(epoch)
        job.oracle.turn_to(epoch.file)
