"""The judgement of an epoch that has ended, as the spy passes it (`spy.verification`) and results contain it."""

import json
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

from problems.oracle_bounds import OracleBounds
from wire.control import Judged
from wire.news import Improvement
from wire.report import Reason
from wire.strict import Rejected

Status = Literal["solved", "optimal", "infeasible", "stalled", "exhausted", "deadline", "cancelled", "failed"]

STATUS_OF: dict[Reason, Status] = {
    "infeasible": "infeasible",
    "stall": "stalled",
    "deadline": "deadline",
    "cancel": "cancelled",
}
"""The status of a run that was stopped for a reason other than its target; of several reasons the first one counts."""


@dataclass(frozen=True)
class Judgement:
    """The judgement of an epoch.

    Attributes:
        status: how the run ended.
        feasible: whether the planner's check accepts the solution.
        message: why the run failed, or the check's objections to the solution.
        best: the best verified answer, if there is one.
        words: the solution in words.
        target: the fitness that counts as solved, if there is one.
        clearance: the clearance of the solution, see `problems.guard.cleared`.
        next_attempt: the fields of the problem to change, if the job is to be restarted; None if it is not.
        solved_when: what the target means, in words, or why there is none.
        advice: settings to change, if the run has stalled for good.
        has_oracle: whether the problem has an oracle, which can tell whether there is a solution at all.
        oracle: the oracle's answer in words, if there is one.
    """

    status: Status
    feasible: bool
    message: str | None
    best: Improvement | None
    words: str | None = None
    target: float | None = None
    clearance: dict[str, Any] | None = None
    next_attempt: dict[str, Any] | None = None
    solved_when: str | None = None
    advice: tuple[str, ...] = ()
    has_oracle: bool = False
    oracle: str | None = None

    def answer(self) -> Judged:
        """Return the judgement as the spy's answer on the wire. The oracle's answer is added later, elsewhere."""
        best = None if self.best is None else self.best.encode()
        fields = None if self.next_attempt is None else json.dumps(self.next_attempt)
        told = self.words, self.target, self.clearance, fields, self.solved_when, self.advice, self.has_oracle
        return Judged(self.status, self.feasible, self.message, best, *told)

    @staticmethod
    def of(answer: Judged) -> "Judgement":
        """The inverse of `answer`.

        Raises:
            Rejected: if there is no such status, or the improvement is not readable.
        """
        for status in get_args(Status):
            if answer.status == status:
                best = None if answer.best is None else Improvement.decode(answer.best)
                fields = None if answer.next_attempt is None else json.loads(answer.next_attempt)
                told = answer.feasible, answer.message, best, answer.words, answer.target, answer.clearance
                return Judgement(status, *told, fields, answer.solved_when, answer.advice, answer.has_oracle)
        raise Rejected("no such status")

    @property
    def is_open(self) -> bool:
        """Whether the oracle's answer may still change the status."""
        return self.has_oracle and self.status in ("stalled", "infeasible") and self.next_attempt is None

    def with_oracle(self, bounds: OracleBounds) -> "Judgement":
        """Return the judgement completed by the oracle's answer: infeasible, optimal, or only its words."""
        if bounds.hopeless:
            return replace(self, status="infeasible", oracle=bounds.words, advice=())
        if self.feasible and self.best is not None and bounds.is_reached_by(self.best.fitness):
            return replace(self, status="optimal", oracle=f"this is the optimum, by {bounds.method}", advice=())
        return replace(self, oracle=bounds.words)
