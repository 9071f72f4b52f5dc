"""Let a job go on from a checkpoint, on processes that know nothing of it."""

from dataclasses import replace

import topologies
from coordinator.jobs.calls import ReplacedError
from coordinator.jobs.checkpoint import Checkpoint
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.epochs import Epoch
from coordinator.jobs.preparing import Preparing
from problems import BadInput, ProblemFile
from topologies import Topology, Torus
from wire.control import Wiring
from wire.takeover import Takeover


class Resuming:
    """Brings the cells of a job to where they were at a checkpoint.

    Args:
        job: the job.
        preparing: prepares the processes.
    """

    def __init__(self, job: ConductedJob, preparing: Preparing) -> None:
        self._job = job
        self._preparing = preparing

    def go_on_from(self, checkpoint: Checkpoint, file: ProblemFile) -> None:
        """Go on in the epoch of the checkpoint; retry if a process dies meanwhile.

        In lockstep every cell goes on from its own state, bit for bit. In async mode, and on another topology, another
        epoch begins with the demes of the checkpoint; its directive says so.

        Args:
            checkpoint: the checkpoint.
            file: its problem file, perhaps with another topology.

        Raises:
            BadInput: if the states do not fit the problem.
        """
        job = self._job
        job.go_back_to(checkpoint.past)
        if checkpoint.epoch == 0 and not checkpoint.states:
            return self._preparing.set_out(0, file)
        job.entry.spec.say(f"goes on from its checkpoint after generation {checkpoint.generation}")
        if others := checkpoint.other_versions():
            job.entry.spec.say(f"may not go on bit for bit: {', '.join(others)}")
        job.dispatch.changed(job.entry, "preparing")
        job.lived_before = checkpoint.lived_before
        if job.best is not None:  # another topology may have no cell of that number
            old, new = topologies.parse(checkpoint.file.run.topology), topologies.parse(file.run.topology)
            job.best = replace(job.best, cell=donor_of(job.best.cell, old, new))
        fresh = False
        while True:
            try:
                return self._go_on(checkpoint, file, fresh)
            except ReplacedError:
                fresh = True  # the new process has no links

    def _go_on(self, checkpoint: Checkpoint, file: ProblemFile, fresh: bool) -> None:
        job = self._job
        wiring = job.dispatch.wire(job.nodes, file.run.topology, fresh)
        since = checkpoint.past.generations - checkpoint.lived_before
        same = Epoch(checkpoint.epoch, checkpoint.file, wiring, since, why=checkpoint.why)
        if not checkpoint.states:
            self._preparing.prepare(same)
            self._begin(same)
        elif file.run.topology == checkpoint.file.run.topology and file.run.mode == "lockstep":
            from node.engine.stored_state import of_job  # not above: it loads compiled code, and few jobs are resumed

            states = [of_job(state, job.number) for _, state in checkpoint.states]
            takeovers = {cell: Takeover(checkpoint.states[cell][0], state, False) for cell, state in enumerate(states)}
            self._preparing.prepare_again(same, takeovers, {})
            self._begin(same)
            if job.best is not None:  # the first that the reader of this run's events learns of it
                job.publish(job.best)
        else:
            self._go_on_elsewhere(checkpoint, same, file, wiring)

    def _go_on_elsewhere(self, checkpoint: Checkpoint, before: Epoch, file: ProblemFile, wiring: Wiring) -> None:
        """Begin another epoch, in which each cell has the deme of a cell of the checkpoint."""
        from node.engine.stored_state import report_of  # not above, see `_go_on`

        job, run = self._job, checkpoint.file.run
        old, new = topologies.parse(run.topology), topologies.parse(file.run.topology)
        before.wiring = Wiring(0, tuple(range(old.cells)))
        try:
            before.reports = {
                cell: report_of(state, cell, run.deme, run.emigrants)
                for cell, (_, state) in enumerate(checkpoint.states)
            }
        except ValueError as error:
            raise BadInput(f"{file.name}: expected a checkpoint of this problem, found another one: {error}") from None
        donors = {cell: donor_of(cell, new, old) for cell in range(new.cells)}
        why = {
            "do": "resume",
            "demes_of": {str(cell): donor for cell, donor in donors.items()},
            "generations": {str(cell): report.generation for cell, report in before.reports.items()},
            "topology": new.spec,
        }
        job.epochs.known = [before]
        epoch = Epoch(before.number + 1, file, wiring, job.generations(before, halted=False), why=why)
        self._preparing.prepare(epoch, {cell: before.reports[donor].deme for cell, donor in donors.items()})
        self._begin(epoch)

    def _begin(self, epoch: Epoch) -> None:
        self._preparing.show_to_the_spy(epoch)
        self._preparing.begin(epoch)


def donor_of(cell: int, new: Topology, old: Topology) -> int:
    """Return the cell of an old topology that is where a cell of a new one is, if both are stretched to one size."""
    if isinstance(new, Torus) and isinstance(old, Torus):
        row, column = divmod(cell, new.columns)
        return row * old.rows // new.rows * old.columns + column * old.columns // new.columns
    return cell * old.cells // new.cells
