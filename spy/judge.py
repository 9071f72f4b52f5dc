"""How a run is judged when it has ended: its status, and whether an independent check accepts the answer."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

from node.plan import Plan
from problems import BadInput
from spy.collector import Collector
from wire.news import Improvement
from wire.report import Reason

Status = Literal["solved", "stalled", "exhausted", "deadline", "cancelled", "failed"]

_STATUS_OF: dict[Reason, Status] = {
    "target": "solved",
    "stall": "stalled",
    "deadline": "deadline",
    "cancel": "cancelled",
}
_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Judgement:
    """What a run came to.

    Attributes:
        feasible: whether the planner's check accepts the solution.
        message: why the run failed, or what the check has against the solution.
        best: the best verified answer, if there is one.
    """

    status: Status
    feasible: bool
    message: str | None
    best: Improvement | None


def judge(collector: Collector, generation: int, reasons: Iterable[Reason], error: str | None = None) -> Judgement:
    """Judge what the spy has collected of a run that stopped after ``generation`` for ``reasons``, or by an error."""
    best = collector.best
    if error is not None:
        return Judgement("failed", False, error, best)
    if collector.disagreement is not None:
        return Judgement("failed", False, collector.disagreement, best)
    status = _status(collector.plan, best, generation, set(reasons))
    if best is None:
        return Judgement(status, False, None, None)
    return _checked(collector.plan, status, best)


def _status(plan: Plan, best: Improvement | None, generation: int, reasons: set[Reason]) -> Status:
    if best is not None and plan.target is not None and best.fitness <= plan.target:
        return "solved"
    if generation == plan.last_generation:
        return "exhausted"
    for reason in ("stall", "deadline", "cancel"):
        if reason in reasons:
            return _STATUS_OF[reason]
    return "failed"


def _checked(plan: Plan, status: Status, best: Improvement) -> Judgement:
    try:
        verdict = plan.problem.check(best.solution)
    except BadInput as error:
        return Judgement("failed", False, f"the check cannot read the solution: {error}", best)
    except Exception as error:
        return Judgement("failed", False, f"the check raised {type(error).__name__}: {error}", best)
    objections = "; ".join(verdict.objections) or None
    if not math.isclose(verdict.fitness, best.fitness, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE):
        message = f"the check finds a fitness of {verdict.fitness:.9g}, the run claims {best.fitness:.9g}"
        return Judgement("failed", False, message, best)
    if status == "solved" and not verdict.feasible and _is_claim(plan, best):
        return Judgement("failed", False, f"the check refuses the solution: {objections}", best)
    return Judgement(status, verdict.feasible, objections, best)


def _is_claim(plan: Plan, best: Improvement) -> bool:
    """Whether the problem itself calls this fitness solved (a looser --target may accept less)."""
    solved_at = plan.problem.solved_at
    return solved_at is None or best.fitness <= solved_at
