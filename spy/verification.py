"""Judge an epoch that has ended: its status, and whether an independent check accepts the answer."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from node.plan import Plan
from problems import BadInput, EvaluationFailed
from problems.guard import advised, checked, cleared, described, merged, solved_at
from problems.oracle_bounds import has_oracle
from spy.collector import Collector
from spy.judgement import STATUS_OF, Judgement, Status
from wire.news import Improvement
from wire.report import Reason

_TOLERANCE = 1e-6  # relative and absolute, between fitness values computed in different ways


def verify(
    collector: Collector,
    generation: int,
    reasons: Iterable[Reason],
    error: str | None = None,
    states: Mapping[int, bytes] | None = None,
    since: int = 0,
) -> Judgement:
    """Judge an epoch that has ended.

    Args:
        collector: what the spy has collected of the epoch.
        generation: the generation after which it stopped.
        reasons: the reasons of the stop.
        error: why a node failed; None if none did.
        states: the states that cells report of their problem objects, to be merged into the solution.
        since: generations of the job before the epoch.
    """
    best = collector.best
    if error is not None:
        return Judgement("failed", False, error, best)
    if collector.disagreement is not None:
        return Judgement("failed", False, collector.disagreement, best)
    plan = collector.plan
    status = _status(plan, best, since + generation, set(reasons))
    if best is None:
        nothing = Judgement(status, False, None, None, None, plan.target, solved_when=plan.solved_when)
        return _going_on(plan, nothing, since + generation)
    try:
        if best.epoch == plan.epoch:  # the states of this epoch's cells do not belong to an earlier epoch's answer
            best = replace(best, solution=merged(plan.problem, best.solution, states or {}, best.cell))
    except EvaluationFailed as failure:
        return Judgement("failed", False, str(failure), best)
    words, when = described(plan.problem, best.solution), plan.solved_when
    judgement = replace(_checked(plan, status, best), words=words, target=plan.target, solved_when=when)
    return _going_on(plan, judgement, since + generation)


def _going_on(plan: Plan, judgement: Judgement, lived: int) -> Judgement:
    """Return the judgement of a stalled run with the next attempt's fields, or with advice if there is none.

    Any other judgement only learns whether there is an oracle to ask. ``lived`` is the number of the job's generations.
    """
    judgement = replace(judgement, has_oracle=plan.run.oracle and has_oracle(type(plan.problem)))
    # A job that is kept alive and has no target is content with any feasible answer.
    found = plan.run.keep_alive and plan.target is None and judgement.feasible
    if judgement.status != "stalled":
        return judgement
    if found or plan.next_attempt is None:
        solution = None if judgement.best is None else judgement.best.solution
        return replace(judgement, advice=advised(plan.problem, solution, plan.run))
    if not plan.leaves_room(lived):
        return replace(judgement, status="exhausted")
    return replace(judgement, next_attempt=plan.next_attempt)


def _status(plan: Plan, best: Improvement | None, generation: int, reasons: set[Reason]) -> Status:
    """Return how the run ended; what came of its answer counts before the reasons of the stop."""
    if best is not None and plan.target is not None and best.fitness <= plan.target:
        return "solved"
    last = plan.last_generation  # counted from the plan's epoch, which a spy's plan does not know: its `since` is 0
    if last is not None and (generation == plan.since + last or not reasons):
        # In async mode cells begin a later epoch in different generations, so they need not end in the last one.
        return "exhausted"
    for reason, status in STATUS_OF.items():
        if reason in reasons:
            return status
    return "failed"


def _checked(plan: Plan, status: Status, best: Improvement) -> Judgement:
    """Let the planner's check examine ``best``; return the judgement: its status, whether feasible, and the message."""
    try:
        verdict = checked(plan.problem, best.solution)
    except BadInput as error:
        return Judgement("failed", False, f"the check cannot read the solution: {error}", best)
    except EvaluationFailed as error:
        return Judgement("failed", False, str(error), best)
    objections, clearance = "; ".join(verdict.objections) or None, cleared(plan.problem, verdict)
    judgement = Judgement(status, verdict.feasible, objections, best, clearance=clearance)
    # In both cases below the problem contradicts itself: the search and the check compute different things. A target
    # that the user has loosened is no such contradiction.
    if not same_fitness(verdict.fitness, best.fitness):
        message = f"the check finds a fitness of {verdict.fitness:.9g}, the run claims {best.fitness:.9g}"
    elif status == "solved" and not verdict.feasible and _is_claim(plan, best):
        message = f"the check refuses the solution: {objections}"
    else:
        return judgement
    return replace(judgement, status="failed", feasible=False, message=message)


def same_fitness(one: float, other: float) -> bool:
    """Return whether two fitness values, computed in different ways, agree."""
    return math.isclose(one, other, rel_tol=_TOLERANCE, abs_tol=_TOLERANCE)


def _is_claim(plan: Plan, best: Improvement) -> bool:
    """Return whether the problem itself counts this fitness as solved; a looser --target may accept a worse one."""
    claimed = solved_at(plan.problem)
    return claimed is None or best.fitness <= claimed
