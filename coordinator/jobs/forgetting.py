"""Let nodes and spy forget jobs that have ended, once no coordinator can need their reports any more."""

import contextlib
from collections.abc import Callable
from functools import partial

import zenoh

from coordinator.jobs.calls import tell
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
        put_off: the numbers of ended jobs that are to be remembered for a while.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, seal: Seal) -> None:
        self.put_off: set[int] = set()
        self._session = session
        self._keys = keys
        self._seal = seal

    def later(self, job: int) -> Callable[[], None]:
        """Return what lets all forget a job."""
        self.put_off.add(job)
        return partial(self._forget, job)

    def _forget(self, job: int) -> None:
        """Let all forget a job, also if it failed: nodes must not go on breeding for it."""
        self.put_off.discard(job)
        with contextlib.suppress(zenoh.ZError):  # the session may be closed; then the processes end anyway
            for key in (self._keys.every_control, self._keys.spy_control):
                tell(self._session, self._seal, key, Drop(job))
