"""Let nodes and spy forget jobs that have ended, once no coordinator can need their reports any more."""

import contextlib
from collections.abc import Callable
from functools import partial

import zenoh

from coordinator.jobs.calls import tell
from spy.result import Result
from wire.control import Drop
from wire.keys import Keys
from wire.seal import Seal


class Forgetting:
    """Tells the processes of a cluster which jobs to forget.

    Args:
        session: a session of the coordinator.
        keys: the key expressions of the cluster.
        seal: signs commands.

    Attributes:
        remembered: the numbers of ended jobs that nobody is to forget yet. Several threads change it: each change is
            one operation of a set, which no other thread can interrupt.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, seal: Seal) -> None:
        self.remembered: set[int] = set()
        self._session = session
        self._keys = keys
        self._seal = seal

    def after(self, job: int, outcome: Result | Exception) -> Callable[[], None]:
        """Return what lets all forget an ended job, which is remembered until then.

        A job that failed is forgotten at once: some of its cells may still breed, and it has no result to be kept.
        """
        forget = partial(self._forget, job)
        if isinstance(outcome, Exception) or outcome.status == "failed":
            forget()
            return lambda: None
        self.remembered.add(job)
        return forget

    def _forget(self, job: int) -> None:
        self.remembered.discard(job)
        with contextlib.suppress(zenoh.ZError):  # the session may be closed; then the processes end anyway
            for key in (self._keys.every_control, self._keys.spy_control):
                tell(self._session, self._seal, key, Drop(job))
