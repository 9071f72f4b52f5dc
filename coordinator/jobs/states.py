"""The states of a job: a table of which state may follow which, and the function that checks every change."""

from types import MappingProxyType
from typing import Literal, get_args

State = Literal[
    "submitted",
    "queued",
    "preparing",
    "running",
    "searching",
    "waiting",
    "solved",
    "optimal",
    "infeasible",
    "stalled",
    "exhausted",
    "deadline",
    "cancelled",
    "failed",
]

ENDS: frozenset[State] = frozenset(
    {"solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled", "failed"}
)
"""Final states."""

BREEDING: frozenset[State] = frozenset({"running", "searching"})
"""States in which nodes breed."""

LIVING: frozenset[State] = BREEDING | {"waiting"}
"""States in which nodes hold the job's individuals."""

_STOPPED: frozenset[State] = frozenset({"cancelled", "deadline", "failed"})  # possible whether or not nodes breed

# "queued" follows a later state only if the cluster has lost the job's individuals: the job starts over then.
TRANSITIONS = MappingProxyType[State, frozenset[State]](
    {
        "submitted": frozenset({"queued"}),
        "queued": _STOPPED | {"preparing"},
        "preparing": _STOPPED | {"running", "searching", "queued"},
        "running": ENDS | {"searching", "waiting", "queued"},
        "searching": ENDS | {"running", "waiting", "queued"},  # kept alive without an answer: makes further attempts
        "waiting": _STOPPED | {"running", "searching", "queued"},  # kept alive with its answer: waits for an update
        **dict.fromkeys(ENDS, frozenset()),
    }
)


class WrongTransition(ValueError):  # noqa: N818
    """A state that does not exist, or cannot follow the present one."""


def follow(now: State, then: str) -> State:
    """Return ``then`` as the state that follows ``now``.

    Raises:
        WrongTransition: if the table does not allow it.
    """
    for state in TRANSITIONS[now]:
        if state == then:
            return state
    expected = ", ".join(sorted(TRANSITIONS[now])) or "nothing more"
    raise WrongTransition(f"after {now!r} comes {expected}, not {then!r}")


def state_of(text: str) -> State:
    """Return the state of that name.

    Raises:
        WrongTransition: if there is no such state.
    """
    for state in get_args(State):
        if state == text:
            found: State = state
            return found
    raise WrongTransition(f"there is no state {text!r}")
