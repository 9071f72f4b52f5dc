"""Verify the results that files claim: nothing in them is believed until the planner's own check has accepted it."""

import contextlib
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from problems import BadInput, Problem, ProblemFile, Solution, Verdict
from problems.guard import checked, cleared, solved_at
from spy.verification import same_fitness
from supernode.runs.results import read_table

_MOST_OBJECTIONS = 3  # objections of the check that are listed; the rest are counted


@dataclass(frozen=True)
class Judgement:
    """What verification finds out about a claimed result.

    Attributes:
        problem: the problem as the run had it.
        solution: the claimed solution; None if the result claims none. A best attempt is not a solution.
        fitness: the fitness that the check finds; infinite if there is nothing to check.
        objections: all that is wrong with the claim; empty if it is accepted.
        clearance: the clearance that the check measures, see `problems.guard.cleared`.
    """

    problem: Problem
    solution: Solution | None
    fitness: float
    objections: list[str]
    clearance: dict[str, Any] | None = None


def verified(file: ProblemFile, result: str) -> Judgement:
    """Verify the result, or the solution alone, in a file as an answer to the problem ``file``.

    Args:
        file: the problem.
        result: the name of a JSON file.

    Raises:
        BadInput: names the file that cannot be used, and says why.
    """
    claim = read_table(result)
    try:
        with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
            return _verified(_as_it_was_run(file, claim), claim)
    except BadInput as error:
        # An error of the problem file names that file; any other one is the result's.
        if str(error).startswith(file.name):
            raise
        raise BadInput(f"{result}: {error}") from None


def _verified(file: ProblemFile, claim: dict[str, Any]) -> Judgement:
    if claim.get("kind", file.kind) != file.kind and "run" in claim:
        # The check of this kind could not read the solution of another one.
        kinds = f"of kind {claim['kind']!r}, and {file.name} is of kind {file.kind!r}"
        return Judgement(file.problem(), None, math.inf, [f"the result is of another problem: it is {kinds}"])
    problem, attempt = file.problem(), claim.get("best_attempt")
    solution = claim.get("solution", claim if attempt is None else None)
    found = attempt if solution is None else solution
    if found is None:
        return Judgement(problem, None, math.inf, ["there is no solution"])
    verdict = checked(problem, found)
    objections = [*_of_another(claim, file), *_few(verdict.objections), *_false_claims(claim, verdict, file)]
    if solution is None:
        objections.insert(0, "there is no solution, only a best attempt")
    return Judgement(problem, solution, verdict.fitness, objections, cleared(problem, verdict))


def _as_it_was_run(file: ProblemFile, claim: dict[str, Any]) -> ProblemFile:
    """Return the problem as the claimed run had it last.

    A whole result names its recipe, which may decide how genomes are decoded, and lists the updates of the problem.
    """
    settings = claim.get("run")
    if not isinstance(settings, dict):
        return file
    known = {name: settings[name] for name in ("recipe", "deme", "target") if name in settings}
    file = file.with_run(**known)
    if claim.get("problem_sha256") == file.sha256:  # the file is the problem that the run had last: change it no more
        return file
    try:
        for update in _updates(claim.get("directives")):
            file = file.changed(update, {})
    except BadInput as error:
        raise BadInput(f"directives: {error}") from None
    return file


def _updates(directives: object) -> Iterator[dict[str, Any]]:
    """Yield the fields that each update of the problem replaced."""
    for directive in directives if isinstance(directives, list) else ():
        # A restart ("retry") has fields as well, but they change how solutions are coded, not the problem.
        is_update = isinstance(directive, dict) and directive.get("do") != "retry"
        if is_update and isinstance(fields := directive.get("fields"), dict):
            yield fields


def _of_another(claim: dict[str, Any], file: ProblemFile) -> list[str]:
    """Return an objection if a whole result is of another problem, which then explains everything else."""
    if claim.get("problem_sha256", file.sha256) == file.sha256:
        return []
    return [f"the result is of another problem than {file.name}: problem_sha256 differs"]


def _few(objections: tuple[str, ...]) -> list[str]:
    """Return the first objections, and how many more there are."""
    more = len(objections) - _MOST_OBJECTIONS
    return [*objections[:_MOST_OBJECTIONS], *([f"and {more} more"] if more > 0 else [])]


def _false_claims(claim: dict[str, Any], verdict: Verdict, file: ProblemFile) -> list[str]:
    """Return what a whole result claims besides its solution and gets wrong: its fitness, and being solved."""
    false = []
    claimed = claim.get("fitness", verdict.fitness)
    claimed = math.inf if claimed is None else claimed
    if not isinstance(claimed, float | int) or not same_fitness(claimed, verdict.fitness):
        false.append(f"the result claims a fitness of {claimed}, the check finds {verdict.fitness:.9g}")
    target = file.run.target if file.run.target is not None else solved_at(file.problem())
    solved = target is None or verdict.fitness <= target or same_fitness(verdict.fitness, target)
    if claim.get("solved") is True and not solved:
        false.append(f"the result claims to be solved, the target is {target}")
    return false
