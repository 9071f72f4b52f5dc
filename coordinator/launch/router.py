"""The embedded Zenoh router, in a process of its own: the control plane of a cluster."""

import contextlib
import os
import queue
import re
import resource
import threading
import time
from collections.abc import Sequence

import zenoh

from coordinator.errors import ClusterFailed
from coordinator.launch.refusals import Refusals
from coordinator.log_lines import LogLines
from wire import access, sessions
from wire.keys import Keys
from wire.members import BadMemberError, Identity
from wire.news import LogRecord

_LOOK_AGAIN = 0.5  # seconds between two looks: for signals, and whether the keys or the list of members have changed
_MOST_UNPUBLISHED = 1000  # lines about refusals
_SAME_PORT_WITHIN = 10.0  # seconds in which a port is free again that this process had


def route(
    endpoints: Sequence[str], ready: int, identity: Identity | None = None, lines: LogLines | None = None
) -> None:
    """Run a router for everything that connects to one of the ``endpoints``, until the process is killed.

    With an identity it lets members of the cluster do only what their roles and rights allow, and strangers nothing
    (`wire.access`). It takes new keys and a new list of members as soon as the files change: all links are made anew.

    Args:
        endpoints: Zenoh endpoints to listen at.
        ready: a descriptor that gets one byte, ``!``, when the router listens.
        identity: who the router shows itself to be on encrypted links. None: whoever reaches it may do everything.
        lines: where to log that keys were read anew; stderr if None. What was refused is published, as part of the
            cluster's log, which the coordinator keeps.

    Raises:
        ClusterFailed: if the router cannot listen there.
    """
    _, most_files = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (most_files, most_files))  # each node takes one; the default is 1024
    sessions.use_runtime(sessions.ROUTER_RUNTIME)
    router = _Router(endpoints, identity, lines)
    router.open()
    os.write(ready, b"!")
    os.close(ready)
    if identity is None:
        while not router.session.is_closed():
            # Not `signal.pause`: Python handles a signal on this thread, also one that the kernel gave to another one
            # of the process. That one ends no pause, and the router outlived whoever had started it.
            time.sleep(_LOOK_AGAIN)
    else:
        router.renew_for_ever()


class _Router:
    """The router's session.

    Args:
        endpoints, identity, lines: see `route`.

    Attributes:
        session: the session.
    """

    session: zenoh.Session

    def __init__(self, endpoints: Sequence[str], identity: Identity | None, lines: LogLines | None) -> None:
        self._endpoints = endpoints
        self._lines = lines
        self._identity = identity
        if identity is not None:
            said: queue.Queue[str] = queue.Queue(_MOST_UNPUBLISHED)
            threading.Thread(target=_read_refusals, args=(said,), name="refusals", daemon=True).start()
            threading.Thread(target=self._publish_all, args=(said,), name="publisher", daemon=True).start()

    def open(self) -> None:
        """Open the session.

        Raises:
            ClusterFailed: if the router cannot listen, or its files cannot be read.
        """
        rules = None
        if self._identity is not None:
            try:
                rules = access.of_the_router(self._identity.members())
            except (OSError, BadMemberError) as error:
                raise ClusterFailed(f"the list of members: {error}") from None
        try:
            self.session = sessions.router(self._endpoints, self._identity, rules)
        except zenoh.ZError as error:
            raise ClusterFailed(_words(str(error), self._endpoints)) from error

    def renew_for_ever(self) -> None:
        """Open the session anew whenever the keys or the list of members change."""
        assert self._identity is not None, "only a router with keys has files that change"
        seen = self._identity.stamp()
        while True:
            time.sleep(_LOOK_AGAIN)
            now = self._identity.stamp()
            if now != seen:
                seen = now
                self._renew()

    def _renew(self) -> None:
        """Open the session anew; keep the present one if the new list of members cannot be read."""
        assert self._identity is not None
        try:
            self._identity.members()
            self._identity.check()
        except (OSError, BadMemberError) as error:
            return self._log("error", f"the keys and the list of members stay those before: {error}")
        self.session.close()  # type: ignore[no-untyped-call]
        until = time.monotonic() + _SAME_PORT_WITHIN
        while True:
            try:
                self.open()
                return self._log("info", "the keys and the list of members were read anew")
            except ClusterFailed:
                if time.monotonic() > until:
                    raise
                time.sleep(0.05)

    def _log(self, level: str, text: str) -> None:
        lines = self._lines or LogLines("*")
        lines.write(LogRecord(level, "router", text, time.time()))

    def _publish_all(self, said: "queue.Queue[str]") -> None:
        """Publish warnings for ever, in the log of each cluster that the router serves. On a thread of its own."""
        while True:
            record = LogRecord("warning", "router", said.get(), time.time())
            with contextlib.suppress(zenoh.ZError):  # the session is being opened anew
                self.session.put(Keys("*").log, record.encode())


def _read_refusals(said: "queue.Queue[str]") -> None:
    """Note for ever what Zenoh's log tells of refused messages and links; the log goes to standard output.

    Zenoh's threads wait while the pipe is full, perhaps with a lock that a publication needs. So this thread publishes
    nothing itself.
    """

    def say(text: str) -> None:
        with contextlib.suppress(queue.Full):
            said.put_nowait(text)

    reading, writing = os.pipe()
    os.dup2(writing, 1)
    os.close(writing)
    refusals = Refusals(say)
    with os.fdopen(reading, errors="replace") as lines:
        for line in lines:
            refusals.read(line, time.monotonic())


def _words(error: str, endpoints: Sequence[str]) -> str:
    """Return Zenoh's error as a sentence: without places in its source, with the endpoint as far as that is known."""
    named = [each for each in endpoints if each.partition("/")[2] in error]
    number = re.search(r"\(os error (\d+)\)", error)
    reason = error.partition(" at /")[0] if number is None else os.strerror(int(number[1]))
    return f"cannot listen at {' or '.join(named or endpoints)}: {reason}"
