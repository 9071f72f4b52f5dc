"""Change the epoch of a job: an update of its problem, another topology, or another attempt after a stall."""

import topologies
from coordinator.errors import ClusterFailed
from coordinator.jobs.calls import FailedError, GivenUpError, ReplacedError
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.epochs import Epoch
from coordinator.jobs.job import BegunAnew, Change, Moved, Replaced, StopRequest
from coordinator.jobs.preparing import Preparing
from coordinator.jobs.replacing import Replacing
from node.plan import retry
from problems import BadInput
from problems.errors import blaming_the_update
from spy.judgement import Judgement


class Changing:
    """Begins the next epoch of a job, while the current one runs or after it has stopped.

    Args:
        job: the job.
        preparing: prepares and begins the next epoch.
        replacing: replaces processes that die while the job waits for a change.
    """

    def __init__(self, job: ConductedJob, preparing: Preparing, replacing: Replacing) -> None:
        self._job = job
        self._preparing = preparing
        self._replacing = replacing

    def change(self, change: Change) -> None:
        """Begin another epoch as requested; if that is impossible, answer why and stay in the current one.

        Raises:
            ReplacedError: if a process died meanwhile; the change stays first in line.
        """
        try:
            self._begin_another(change)
        except ReplacedError:
            self._job.changes.appendleft(change)  # it is tried again once the dead are replaced
            raise

    def _begin_another(self, change: Change) -> None:
        """Prepare the next epoch, begin it, then stop the current one.

        In this order the nodes breed in the current epoch until all of them are prepared for the next one.
        """
        job = self._job
        before = job.epoch
        try:
            if job.stop_request is not None:
                raise ClusterFailed(f"job {job.entry.spec.job} is being stopped")
            file = before.file.changed(change.fields, change.run)
            if file.sha256 == before.file.sha256 and file.run == before.file.run:
                change.answer.put(before.number)  # a client may repeat a request whose answer it did not get
                return
            same_cells = topologies.parse(file.run.topology).cells == before.cells
            if not same_cells:
                raise BadInput(f"topology: expected one of {before.cells} cells, found {file.run.topology!r}")
            wiring = job.dispatch.wire(job.nodes, file.run.topology)
            epoch = Epoch(before.number + 1, file, wiring, why=_directive(change))
            with blaming_the_update(bool(change.fields)):
                self._preparing.prepare(epoch)
        except (GivenUpError, ReplacedError):
            raise
        except FailedError as error:  # not only the change, but the job
            change.answer.put(error)
            raise
        except Exception as error:  # nothing has begun yet, so the current epoch continues whatever is wrong
            change.answer.put(error)
            return
        self._preparing.show_to_the_spy(epoch)
        self._preparing.begin(epoch)
        job.stop(before.number, "update")
        change.answer.put(epoch.number)

    def try_again(self, judgement: Judgement) -> None:
        """Begin another attempt, with new individuals, after an epoch that has stalled without an answer.

        Raises:
            ClusterFailed: if the problem's ``next_attempt`` returned fields that make no valid problem.
        """
        job = self._job
        before, best, fields = job.epoch, judgement.best, judgement.next_attempt or {}
        if best is not None and best.epoch == before.number:
            job.improve(best)
            job.best = best  # the judged one: its solution includes what cells reported of their states
        try:
            file, fresh = before.file.next_attempt(fields), False
        except BadInput as error:
            raise ClusterFailed(str(error)) from error
        why = retry(file, before.number + 1, fields)
        since = job.generations(before, halted=False)
        while True:
            wiring = job.dispatch.wire(job.nodes, file.run.topology, fresh)
            epoch = Epoch(before.number + 1, file, wiring, since, why=why)
            try:
                self._preparing.prepare(epoch)
                self._preparing.show_to_the_spy(epoch)
                job.entry.tell(BegunAnew(why))
                return self._preparing.begin(epoch)
            except ReplacedError:
                fresh = True  # the new node needs links, but no deme: all cells draw new individuals
            except BadInput as error:
                raise ClusterFailed(str(error)) from error

    def wait_for_a_change(self) -> bool:
        """Wait, in a job that is kept alive, for a change that begins another epoch; return False if it is stopped.

        The cells have stopped meanwhile, but keep their demes.
        """
        job = self._job
        job.dispatch.changed(job.entry, "waiting")
        before = job.epoch
        while job.epoch is before:  # its number may be the same, if all nodes died and it went on from a checkpoint
            message = job.changes.popleft() if job.changes else job.calls.next()
            try:
                if isinstance(message, StopRequest):
                    job.stop_request = message
                    return False
                if isinstance(message, Change):
                    self.change(message)
                elif isinstance(message, Moved):
                    self._replacing.move(message.nodes)
                elif isinstance(message, Replaced):
                    raise ReplacedError(message)
            except ReplacedError as replaced:
                self._replacing.replace(replaced.node)
        return True


def _directive(change: Change) -> dict[str, object]:
    """Return the directive of a change, by which a simulation repeats it."""
    if change.run:
        return {"do": "rewire", **change.run}
    return {"do": "update", "fields": change.fields}
