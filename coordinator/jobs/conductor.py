"""Conduct one job: prepare and start its nodes, pass stop requests on, gather reports, have the result verified.

A job is a sequence of epochs. An update of the problem, a new topology and the replacement of a dead node all work the
same way: the conductor prepares the next epoch on every node and begins it, the previous epoch is stopped, and each
node continues in the next one with the deme that it has. A node that receives the command to begin finishes the
previous epoch first. At most two epochs are in progress at any time.

Each phase of conducting has a class of its own: `preparing`, `running`, `changing` epoch, `replacing` dead processes
and `ending`. What they share is `conducted_job.ConductedJob`.

Threads: each conductor runs on a thread of its own and is driven by one queue (see `coordinator.jobs.calls`). Zenoh's
network thread calls only `ConductedJob.improve`.
"""

import time
from collections.abc import Callable

import zenoh

from coordinator.jobs.calls import Calls, GivenUpError, HaltedError, MovedError, ReplacedError
from coordinator.jobs.changing import Changing
from coordinator.jobs.checkpointing import Checkpointing
from coordinator.jobs.conducted_job import ConductedJob, ConductorServices
from coordinator.jobs.ending import Ending
from coordinator.jobs.job import JobEntry, Placement, StopRequest
from coordinator.jobs.preparing import Preparing
from coordinator.jobs.replacing import Replacing
from coordinator.jobs.resuming import Resuming
from coordinator.jobs.running import EVAL_TIMEOUT, Running
from problems import BadInput
from spy.judgement import Judgement
from spy.past import Lived
from spy.result import Clocks, Result, result_of
from wire.keys import Keys
from wire.seal import Seal

_LASTING = ("solved", "stalled")  # endings after which a job may continue, by another attempt or in another epoch


class Conductor:
    """The conductor of one job.

    Args:
        entry: the job; its queue is this conductor's mailbox.
        session: a Zenoh session through the router.
        seal: signs commands for the cluster's processes.
        keys: the key expressions of the cluster.
        nodes: the nodes of the job, in the order of its cells. Empty if the job must end without ever having run: then
            the conductor only reads its queue for the reason.
        dispatch: the dispatcher that runs this conductor.
        replaces: whether the cluster replaces dead processes.
        checked: whether the problem was checked before, so that the spy need not check it before the nodes read it.
        eval_timeout: see `Running`.
        adopted: the state of the job, if it was running when the previous coordinator died.

    Attributes:
        job: what is known of the job.
    """

    def __init__(
        self,
        entry: JobEntry,
        session: zenoh.Session,
        seal: Seal,
        keys: Keys,
        nodes: tuple[int, ...],
        dispatch: ConductorServices,
        *,
        replaces: bool = False,
        checked: bool = False,
        eval_timeout: float = EVAL_TIMEOUT,
        adopted: Placement | None = None,
    ) -> None:
        calls = Calls(session, seal, entry.queue, replaces)
        self.job = ConductedJob(entry, calls, keys, nodes, dispatch, adopted)
        self._adopted = adopted
        self._seconds = 0.0
        self._preparing = Preparing(self.job, checked)
        self._resuming = Resuming(self.job, self._preparing)
        self._replacing = Replacing(self.job, self._preparing, self._resuming, eval_timeout)
        self._changing = Changing(self.job, self._preparing, self._replacing)
        checkpointing = Checkpointing(self.job, adopted is None and entry.spec.checkpoint is None)
        self._running = Running(self.job, self._changing, checkpointing, eval_timeout)
        self._ending = Ending(self.job)

    def conduct(self, seconds_to_ready: float, cpu_seconds: Callable[[], dict[str, float]]) -> Result:
        """Run the job to its end and return its result.

        A cluster that fails or a problem that breaks while it runs is a result of status "failed", not an exception.

        Args:
            seconds_to_ready: how long the cluster took to start, for the result.
            cpu_seconds: returns the CPU time that each process has used so far, by name.

        Raises:
            BadInput: if the problem is wrong.
        """
        job, spec = self.job, self.job.entry.spec
        used = cpu_seconds()
        judgement = self._judgement()
        if judgement.best is not None:
            job.improve(judgement.best)
        # A process that came meanwhile has no earlier figure; one that went has no later one.
        spent = sum(after - used[name] for name, after in cpu_seconds().items() if name in used)
        clocks = Clocks(self._seconds, seconds_to_ready, spent)
        never_begun = spec.past, Lived(spec.file, number=spec.past.epochs)
        past, epoch = job.epochs.whole() if job.epochs else never_begun
        name = spec.job or str(job.number)
        return result_of(name, (spec.first or spec.file).run, past, epoch, judgement, job.versions, clocks)

    def _judgement(self) -> Judgement:
        """Run the job and return its judgement, also if the cluster fails.

        Raises:
            BadInput: if the problem is wrong.
        """
        try:
            return self._ending.with_the_oracle(self._run())
        except BadInput:
            raise
        except Exception as error:  # any mistake must still end the job: clients wait for its result
            return self._ending.after(error)
        finally:
            self.job.oracle.close()

    def _run(self) -> Judgement:
        """Run epoch after epoch until the job ends; return the judgement of the last one.

        Raises:
            GivenUpError: if the job is stopped before it has begun.
            ClusterFailed: if it cannot continue.
            BadInput: if the problem is wrong.
        """
        job = self.job
        if not job.nodes:
            raise GivenUpError(self._stop_in_the_queue())
        checkpoint = job.entry.spec.checkpoint
        if self._adopted is not None:
            self._replacing.take_over(self._adopted)
        elif checkpoint is not None:
            self._resuming.go_on_from(checkpoint, job.entry.spec.file)
        else:
            self._preparing.set_out(job.epochs.past.epochs, job.entry.spec.file)
        began = time.monotonic()
        try:
            while True:
                judgement = self._live()
                # The spy decides whether there is to be another attempt, see `spy.verification`.
                seeks, waits = judgement.next_attempt is not None, job.epoch.file.run.keep_alive
                if judgement.status not in _LASTING or not (seeks or waits):
                    return judgement
                if job.stop_request is not None:  # it came when the epoch was about to end by itself
                    return self._ending.as_requested(judgement) if seeks else judgement
                if seeks:
                    if judgement.has_oracle:
                        job.oracle.ask()
                    self._changing.try_again(judgement)
                elif not self._changing.wait_for_a_change():
                    return self._ending.as_requested(judgement)
        finally:
            self._seconds = time.monotonic() - began  # since the first epoch began, or this coordinator took over

    def _stop_in_the_queue(self) -> StopRequest:
        """Return the stop request that ended a job before it got nodes.

        The dispatcher puts a stop request or a failure into the queue before it starts a conductor without nodes, so
        this does not wait for ever.
        """
        while not isinstance(message := self.job.calls.next(), StopRequest):
            pass  # such as a change of a job that will never run: `Job.update` sees that the job has ended
        return message

    def _live(self) -> Judgement:
        """Conduct until the latest epoch has stopped; return its judgement.

        Stop requests, changes and deaths are dealt with meanwhile, so the latest epoch may be another one in the end.
        """
        while True:
            try:
                error = self._running.gather()
                return self._ending.judge(error)
            except ReplacedError as replaced:
                self._replacing.replace(replaced.node)
            except MovedError as moved:
                self._replacing.move(moved.nodes)
            except HaltedError:
                self._replacing.go_on_from_a_halt()
