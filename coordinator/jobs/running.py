"""Wait until the latest epoch of a job has stopped; stops and changes are begun meanwhile."""

import time
from collections import Counter

from coordinator.jobs.calls import ASK_AGAIN, HaltedError, MovedError, ReplacedError, Reported, StatesTold
from coordinator.jobs.changing import Changing
from coordinator.jobs.checkpointing import Checkpointing
from coordinator.jobs.conducted_job import ConductedJob
from coordinator.jobs.job import Change, Moved, Replaced, Returned, StopRequest
from coordinator.jobs.recovering import looks
from wire.control import Look

EVAL_TIMEOUT = 60.0  # seconds
_MOST_IN_VAIN = 10  # questions for the reports of an epoch, one soon after another unless cells are at work in it


class Running:
    """Waits for the reports of a job's cells while they breed.

    Args:
        job: the job.
        changing: begins the epochs that are requested meanwhile.
        checkpointing: makes checkpoints meanwhile.
        eval_timeout: how many seconds an evaluation may go on once the job is stopped.
    """

    def __init__(
        self, job: ConductedJob, changing: Changing, checkpointing: Checkpointing, eval_timeout: float
    ) -> None:
        self._job = job
        self._changing = changing
        self._checkpointing = checkpointing
        self._eval_timeout = eval_timeout
        self._give_up_at: float | None = None  # when cells that have not stopped never will; on the monotonic clock
        self._asked_in_vain: Counter[int] = Counter()  # by epoch, how often its reports were asked for
        self._ask_at: float | None = None  # when to ask for reports again; on the monotonic clock

    def gather(self) -> str | None:
        """Wait for the report of every cell; return the message of the first that failed, without waiting for others.

        Raises:
            ReplacedError: if a process died and was replaced meanwhile.
            MovedError: if cells are to go on on other nodes.
            HaltedError: if cells are halted in the latest epoch, so that another one must begin.
            ClusterFailed: if the job cannot continue.
            GivenUpError: if it was stopped, but cells go on: their evaluation does not end.
        """
        job = self._job
        while job.epochs.unsettled:
            if job.epochs.settled:  # all cells are in the latest epoch, so stops and changes can be sent now
                self._send_what_was_put_off()
            message = job.calls.next(
                _sooner(self._ask_at, job.oracle.look_at, self._give_up_at, self._checkpointing.look_at)
            )
            if message is None:
                self._look_at_the_clock()
            elif isinstance(message, StatesTold):
                self._checkpointing.hear(message)
            elif isinstance(message, Reported):
                if message.report is None:
                    # The question has ended without all reports: its time was over, or the router died. Ask again,
                    # unless it has been asked again already.
                    is_latest = any(message.question == epoch.asked for epoch in job.epochs.unsettled)
                    self._ask_at = time.monotonic() + ASK_AGAIN if is_latest else self._ask_at
                elif (error := job.note(message.epoch, message.report)) is not None:
                    return error
                elif message.report.halted and message.epoch == job.epoch.number:
                    raise HaltedError
            else:
                self._attend_to(message)
        return None

    def _look_at_the_clock(self) -> None:
        """Ask for reports again if that is due, and look whether the oracle has answered."""
        job = self._job
        if self._ask_at is not None and time.monotonic() >= self._ask_at:
            self._ask_at = None
            self._ask_again()
        if self._give_up_at is not None and time.monotonic() >= self._give_up_at and job.stop_request is not None:
            job.give_up(job.stop_request, self._eval_timeout)
        self._checkpointing.look()
        job.oracle.look()
        if job.oracle.is_hopeless and job.stop_request is None:
            self._attend_to(StopRequest("infeasible"))

    def _ask_again(self) -> None:
        """Ask for reports again and repeat the stops, which a dead router may have lost; both are idempotent."""
        job = self._job
        for epoch in job.epochs.unsettled:
            if epoch is not job.epoch:
                self._asked_in_vain[epoch.number] += 1
                if self._asked_in_vain[epoch.number] >= _MOST_IN_VAIN and self._is_left():
                    epoch.dead.update(set(range(epoch.cells)) - epoch.reports.keys())
                    continue
                job.stop_everywhere(epoch.number, "update")
            job.ask_for_reports(epoch)
        job.unsent_stop = job.stop_request

    def _is_left(self) -> bool:
        """Return whether all cells are in the latest epoch: reports of the one before are lost if none has them then.

        A process that took the place of a dead one in the latest epoch has none of its predecessor's, and a coordinator
        that has taken over does not either.
        """
        job = self._job
        answers = job.calls.ask([(job.keys.every_control, Look(job.number))], 0, give_up=False)
        epochs = [look["epoch"] for look in looks(answers) if look["cell"] is not None]
        return len(epochs) == job.epoch.cells and set(epochs) == {job.epoch.number}

    def _send_what_was_put_off(self) -> None:
        """Send a stop or begin a change that came while cells were still moving to the latest epoch.

        A cell that has not begun the latest epoch would ignore a stop in it, and there cannot be three epochs at once.
        """
        job = self._job
        if job.unsent_stop is not None:
            job.stop(job.epoch.number, job.unsent_stop.reason)
            job.unsent_stop = None
        if job.changes:  # one at a time: then the cells are on their way again
            self._changing.change(job.changes.popleft())

    def _attend_to(self, message: object) -> None:
        """Note a request; it is carried out by `_send_what_was_put_off` when the cells are ready for it.

        Raises:
            ReplacedError: if the message is that a process was replaced.
            MovedError: if it is that nodes leave.
        """
        if isinstance(message, StopRequest):
            self._job.stop_request = self._job.stop_request or message
            self._job.unsent_stop = message
            self._give_up_at = self._give_up_at or time.monotonic() + self._eval_timeout
        elif isinstance(message, Replaced):
            raise ReplacedError(message)
        elif isinstance(message, Moved):
            raise MovedError(message)
        elif isinstance(message, Returned):  # it may have missed the question for its report, which begins the epoch
            self._ask_at = self._ask_at or time.monotonic() + ASK_AGAIN
        elif isinstance(message, Change):
            self._job.changes.append(message)


def _sooner(*times: float | None) -> float | None:
    """Return the earliest of the given times; None if there is none."""
    return min((each for each in times if each is not None), default=None)
