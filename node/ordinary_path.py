"""The ordinary path of an exchange, where the fast path must not be used: `lowlevel.capabilities`."""

from collections.abc import Callable
from typing import Any

from node.assignment import Assignment


class OrdinaryPath:
    """Stands in for `node.fast_path.FastPath`, and is never open: every message is handled in Python."""

    def make_handler(self, sender: int, ordinary: Callable[[Any], None]) -> Callable[[Any], None]:
        """Return the ordinary handler of a sender's samples."""
        return ordinary

    def is_open(self, assignment: Assignment) -> bool:
        """Return False."""
        return False

    def close(self, assignment: Assignment) -> bool:
        """Return False: it was not open."""
        return False

    def forget(self, assignment: Assignment) -> None:
        """Do nothing: nothing is kept of an assignment."""

    def open(self, assignment: Assignment, go_on: Callable[[Assignment], None]) -> None:
        """Do nothing: messages go on to be handled in Python."""

    def end_turn(self, over_at: float) -> bool:
        """Return False: nothing was bred."""
        return False
