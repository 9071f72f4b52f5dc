"""The life of a job: one table of which state may follow which, and the one function that every change goes through."""

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
"""States that nothing follows."""

BREEDING: frozenset[State] = frozenset({"running", "searching"})
"""States in which nodes breed."""

LIVING: frozenset[State] = BREEDING | {"waiting"}
"""States in which nodes have the job's individuals."""

_STOPPED: frozenset[State] = frozenset({"cancelled", "deadline", "failed"})  # whether or not anything was found

# "queued" follows a later state only when the cluster has lost what the job had reached: it starts over.
TRANSITIONS = MappingProxyType[State, frozenset[State]](
    {
        "submitted": frozenset({"queued"}),
        "queued": _STOPPED | {"preparing"},
        "preparing": _STOPPED | {"running", "searching", "queued"},
        "running": ENDS | {"searching", "waiting", "queued"},
        "searching": ENDS | {"running", "waiting", "queued"},  # kept alive, begins anew until it has an answer
        "waiting": _STOPPED | {"running", "searching", "queued"},  # has its answer, and is kept alive for what follows
        **dict.fromkeys(ENDS, frozenset()),
    }
)


class WrongTransition(ValueError):  # noqa: N818
    """A state that cannot follow the one before it."""


def follow(now: State, then: str) -> State:
    """``then``, the state after ``now``.

    Raises:
        WrongTransition: if it is not in the table.
    """
    for state in TRANSITIONS[now]:
        if state == then:
            return state
    expected = ", ".join(sorted(TRANSITIONS[now])) or "nothing more"
    raise WrongTransition(f"after {now!r} comes {expected}, not {then!r}")


def state_of(text: str) -> State:
    """The state of that name.

    Raises:
        WrongTransition: if there is none.
    """
    for state in get_args(State):
        if state == text:
            found: State = state
            return found
    raise WrongTransition(f"there is no state {text!r}")
