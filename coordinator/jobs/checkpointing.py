"""Make checkpoints of a running job, every so many seconds.

Neighbours keep each cell's latest states (`node.engine.state`). The conductor asks for them, and takes the latest
generation in which there is a state of every cell: what the cells hold then is consistent without stopping any. So a
checkpoint costs the cells one answer. In async mode there is no common generation, and the latest states are taken.
"""

import time
from collections.abc import Iterable

from coordinator.jobs.calls import StatesTold
from coordinator.jobs.checkpoint import Checkpoint
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.epochs import Epoch
from coordinator.jobs.job import CheckpointFailed
from wire.control import TellStates
from wire.takeover import KeptStates

_SOON = 1.0  # seconds from the beginning of an epoch to its first checkpoint, and to the next try after one without


class Checkpointing:
    """Makes checkpoints of one job; only its conductor's thread uses it, and no method waits for other processes.

    Args:
        job: the job.
        begins: whether it begins now; if not, it goes on in an epoch that an earlier coordinator has begun.

    Attributes:
        look_at: when to call `look`, on the monotonic clock; None if nothing is to be done.
    """

    def __init__(self, job: ConductedJob, begins: bool) -> None:
        self._job = job
        self._begins = begins
        self._every = job.entry.spec.checkpoint_every
        self.look_at = None if self._every is None else 0.0
        self._question: int | None = None  # whose answers are awaited
        self._pause = _SOON  # seconds from a question without a checkpoint to the next one
        self._told: list[KeptStates] = []
        self._epoch: Epoch | None = None  # of the latest checkpoint or question
        self._has_failed = False

    def look(self) -> None:
        """Ask the cells for states if that is due."""
        now = time.monotonic()
        if self._every is None or self.look_at is None or now < self.look_at:
            return
        job = self._job
        self.look_at = now + min(_SOON, self._every)
        if not job.epochs.settled or job.epoch.dead or job.stop_request is not None:
            return  # cells are still on their way to the latest epoch, or about to leave it
        if self._epoch is not job.epoch:
            self._epoch, self._pause = job.epoch, min(_SOON, self._every)
            if self._begins and (job.epoch.is_fresh or job.epoch.number == 0):
                self._save(())  # so that even a job that ends now can go on
            self._begins = True
        self._told.clear()
        self.look_at = None  # until the question is over: a cell answers between two generations
        command = TellStates(job.number, job.epoch.number, once=True, wiring=job.epoch.wiring_number)
        self._question = job.calls.ask_for_states(job.keys.every_control, command)

    def hear(self, told: StatesTold) -> None:
        """Take a cell's answer; make a checkpoint once there are states of all cells."""
        epoch = self._job.epoch
        if told.question != self._question or self._every is None:
            return
        if told.kept is not None:
            self._told.append(told.kept)
            if len(self._told) < epoch.cells:
                return
        self._question = None
        states = consistent_states(self._told, epoch.cells, epoch.file.run.mode) if epoch is self._epoch else ()
        self._told.clear()
        if states:
            self._save(states)
            self._pause = self._every
        else:  # more and more seldom, since there may never be any: cells without neighbours, or with long states
            self._pause = min(self._every, 2.0 * self._pause)
        self.look_at = time.monotonic() + self._pause

    def _save(self, states: tuple[tuple[int, bytes], ...]) -> None:
        """Have a checkpoint kept; if that fails, say so once and go on without."""
        job, spec = self._job, self._job.entry.spec
        past, _ = job.epochs.whole()
        checkpoint = Checkpoint(
            spec.first or spec.file,
            job.epoch.file,
            job.epoch.number,
            job.epoch.why,
            past,
            job.lived_before,
            job.best,
            time.monotonic() - spec.submitted,
            states,
            job.versions,
        )
        if states:
            job.checkpoint = checkpoint
        try:
            spec.keep_checkpoint(checkpoint)
        except OSError as error:
            if not self._has_failed:
                job.entry.tell(CheckpointFailed(str(error)))
            self._has_failed = True
        else:
            self._has_failed = False


def consistent_states(told: Iterable[KeptStates], cells: int, mode: str) -> tuple[tuple[int, bytes], ...]:
    """Return generation and state of each cell from which all can go on together; nothing if there are none.

    Args:
        told: what the cells keep of each other.
        cells: the number of cells.
        mode: in lockstep all states are of one generation, the latest that is possible.
    """
    by_cell: dict[int, dict[int, bytes]] = {}
    for each in told:
        for cell, generation, state in each.states:
            by_cell.setdefault(cell, {})[generation] = state
    if len(by_cell) < cells:
        return ()
    if mode == "async":
        return tuple(max(by_cell[cell].items()) for cell in sorted(by_cell))
    common = set.intersection(*(set(states) for states in by_cell.values()))
    return tuple((max(common), by_cell[cell][max(common)]) for cell in sorted(by_cell)) if common else ()
