"""Jobs that live in several epochs: their states are watched, and they are repeated here from their results."""

import hashlib
import itertools
import threading

from node.replay import replay
from spy.past import Lived, Past


class States:
    """Hooks of a dispatcher that keep each job's states, to be waited for."""

    def __init__(self):
        self.told = []  # (job, status), in their order
        self._changed = threading.Condition()

    def changed(self, number, status, nodes):
        with self._changed:
            self.told.append((number, status))
            self._changed.notify_all()

    def placed(self, number, placement):
        pass

    def improved(self, number, improvement):
        pass

    def lived(self, number, epoch, records):
        pass

    def ended(self, number, outcome, forget):
        forget()

    def wait(self, job, status, times=1, timeout=60):
        """Until a job has come into a state so many times."""
        state = (job.spec.number, status)
        with self._changed:
            assert self._changed.wait_for(lambda: self.told.count(state) >= times, timeout), (state, self.told)

    def of(self, job):
        with self._changed:
            return [status for number, status in self.told if number == job.spec.number]

    def order_of(self, status, jobs):
        """The places in ``jobs`` in the order in which they came into a state."""
        numbers = [job.spec.number for job in jobs]
        with self._changed:
            return [numbers.index(number) for number, each in self.told if each == status and number in numbers]


def history(lived):
    """The digest that a result has of the epochs that were lived through."""
    before = b""
    for epoch, after in itertools.zip_longest(lived, lived[1:]):
        if after is None or after.why["do"] != "replace":
            before = hashlib.sha256(before + b"".join(report.digest for report in epoch.reports)).digest()
    return before.hex()


def again(file, result):
    """The history of the run that a result tells of, lived through once more."""
    return history(replay(file.with_run(**result.run), result.directives))


def turns_of(result):
    """What led from epoch to epoch."""
    return [(each["do"], each["epoch"]) for each in result.directives if each["do"] != "stop"]


def best_again(file, result):
    """The best that is known at the end of the run that a result tells of, lived through once more."""
    *before, last = replay(file.with_run(**result.run), result.directives)
    past = Past()
    for epoch, then in zip(before, [*before[1:], last], strict=True):
        past = past.and_then(Lived(epoch.file, epoch.reports, epoch.plan.epoch), then.why)
    return past.or_better(Lived(last.file, last.reports, last.plan.epoch))
