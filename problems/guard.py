"""A fence around a problem's own code: whatever it does, the caller gets what it asked for or one clear error."""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from problems.errors import BadInput, EvaluationFailed, one_line, shorten
from problems.motion import Motion, Pace
from problems.problem import MOST_REPORT_BYTES, Answer, Clearance, Problem, Solution, Verdict
from problems.run import Run

_ANYTHING = (Exception, SystemExit)


def guarded(problem: Problem) -> Evaluate:
    """``problem.evaluate`` that raises `EvaluationFailed` if it raises or returns NaN, or not one value for each."""
    from genetics.selection import unsound

    def evaluate(genomes: Genomes) -> Fitness:
        try:
            # A copy: what the problem returned may be read-only, or an array that it will use again.
            fitness = np.array(problem.evaluate(genomes), dtype=np.float64, order="C")
        except _ANYTHING as error:
            raise _raised(problem, "evaluate", error) from error
        if fitness.shape != (len(genomes),):
            raise EvaluationFailed(
                f"{problem.kind}: evaluate must return an array of shape ({len(genomes)},), got {fitness.shape}"
            )
        if (wrong := unsound(fitness)) >= 0:
            raise EvaluationFailed(
                f"{problem.kind}: evaluate must not return NaN or -inf, got {fitness[wrong]}"
                f" for genome {genomes[wrong].tobytes().hex()}"
            )
        return fitness

    return evaluate


def decoded(problem: Problem, genome: Genomes) -> Solution:
    """What ``problem.decode`` returns, if it is a table of plain JSON values.

    Raises:
        EvaluationFailed: if it raises, or returns something else.
    """
    try:
        solution = problem.decode(genome)
    except _ANYTHING as error:
        raise _raised(problem, "decode", error) from error
    return _plain(problem, "decode", solution)


def reported(problem: Problem) -> bytes:
    """What ``problem.report`` returns.

    Raises:
        EvaluationFailed: if it raises, or returns something else than a few bytes.
    """
    try:
        report = problem.report()
    except _ANYTHING as error:
        raise _raised(problem, "report", error) from error
    if not isinstance(report, bytes) or len(report) > MOST_REPORT_BYTES:
        raise EvaluationFailed(f"{problem.kind}: report must return at most {MOST_REPORT_BYTES} bytes")
    return report


def merged(problem: Problem, solution: Solution, reports: Mapping[int, bytes], finder: int) -> Solution:
    """What ``problem.merge`` returns, if it is a table of plain JSON values.

    Raises:
        EvaluationFailed: if it raises, or returns something else.
    """
    try:
        whole = problem.merge(solution, reports, finder)
    except _ANYTHING as error:
        raise _raised(problem, "merge", error) from error
    return _plain(problem, "merge", whole)


def checked(problem: Problem, solution: Solution) -> Verdict:
    """What ``problem.check`` returns.

    Raises:
        BadInput: if it says that this is no solution of such a problem.
        EvaluationFailed: if it raises anything else, or returns no verdict.
    """
    try:
        verdict = problem.check(solution)
    except BadInput:
        raise
    except _ANYTHING as error:
        raise _raised(problem, "check", error) from error
    good = isinstance(verdict, Verdict) and isinstance(verdict.fitness, float | int) and not math.isnan(verdict.fitness)
    if not good or not all(isinstance(each, str) for each in verdict.objections):
        raise EvaluationFailed(
            f"{problem.kind}: check must return a supernode.Verdict of a fitness and objections, got {verdict!r}"
        )
    if verdict.clearance is not None and not _is_measured(verdict.clearance):
        raise EvaluationFailed(
            f"{problem.kind}: check must return a supernode.Clearance of a number and plain JSON values, got"
            f" {verdict.clearance!r}"
        )
    return verdict


def cleared(problem: Problem, verdict: Verdict) -> dict[str, Any] | None:
    """The clearance that a verdict tells, as results hold it.

    Returns:
        ``"least"`` (None if there is nothing to come close to), ``"where"``, ``"required"``, which is the field
        ``clearance`` of the problem, or 0, and the ``"unit"`` of both; None if the verdict tells of no clearance.
    """
    clearance = verdict.clearance
    if clearance is None:
        return None
    required = getattr(problem, "clearance", 0.0)
    return {
        "least": float(clearance.least) if math.isfinite(clearance.least) else None,
        "where": clearance.where,
        "required": float(required) if isinstance(required, float | int) else 0.0,
        "unit": clearance.unit,
    }


def foretold(problem: Problem) -> Answer:
    """What ``problem.oracle`` returns.

    Raises:
        BadInput: if there is no oracle for this problem.
        EvaluationFailed: if it raises anything else, or returns no answer.
    """
    try:
        answer = problem.oracle()
    except BadInput:
        raise
    except _ANYTHING as error:
        raise _raised(problem, "oracle", error) from error
    if not isinstance(answer, Answer) or math.isnan(answer.fitness):
        raise EvaluationFailed(f"{problem.kind}: oracle must return a supernode.Answer, got {shorten(answer)}")
    try:
        json.dumps([answer.solution, dict(answer.figures)])
    except (TypeError, ValueError, RecursionError) as error:
        raise EvaluationFailed(f"{problem.kind}: oracle must answer in plain JSON values: {error}") from error
    return answer


def moved(problem: Problem, solution: Solution, pace: Pace) -> Motion | None:
    """What ``problem.motion`` returns.

    Raises:
        BadInput: if it says that the pace does not suit.
        EvaluationFailed: if it raises anything else, or returns no motion of finite numbers.
    """
    try:
        with np.errstate(all="ignore"):  # of speeds beyond reason, too many rows are all there is to say
            motion = problem.motion(solution, pace)
        if motion is None:
            return None
        times = motion.times
        good = all(
            column.values.shape == times.shape and np.isfinite(column.values).all() for column in motion.columns()
        )
    except BadInput:
        raise
    except _ANYTHING as error:
        raise _raised(problem, "motion", error) from error
    if not good or not len(times) or times[0] < 0.0 or np.any(np.diff(times) <= 0.0):
        raise EvaluationFailed(f"{problem.kind}: motion must return finite numbers for moments that increase from 0")
    return motion


def described(problem: Problem, solution: Solution) -> str:
    """What ``problem.describe`` returns, or the solution as it is if that is no text."""
    try:
        words = problem.describe(solution)
    except _ANYTHING:
        words = ""
    return words if isinstance(words, str) and words else Problem.describe(problem, solution)


def advised(problem: Problem, found: Solution | None, run: Run) -> tuple[str, ...]:
    """What ``problem.advice`` says, each in one line, if it says anything."""
    try:
        lines = [one_line(each) for each in problem.advice(found, run) if isinstance(each, str) and each]
    except _ANYTHING:
        return ()
    return tuple(lines)


def solved_at(problem: Problem) -> float | None:
    """What ``problem.solved_at`` is.

    Raises:
        BadInput: if it raises, or is neither a number nor None.
    """
    try:
        fitness = problem.solved_at
    except _ANYTHING as error:
        raise BadInput(f"{problem.kind}: solved_at raised {type(error).__name__}: {error}") from error
    if fitness is None:
        return None
    if isinstance(fitness, bool) or not isinstance(fitness, float | int | np.floating) or math.isnan(fitness):
        raise BadInput(f"{problem.kind}: solved_at must be a number or None, got {fitness!r}")
    return float(fitness)


def solved_when(problem: Problem) -> str | None:
    """What ``problem.solved_when`` says, in one line, if it says anything."""
    try:
        words = problem.solved_when
    except _ANYTHING:
        return None
    return one_line(words) if isinstance(words, str) and words else None


def _is_measured(clearance: Any) -> bool:
    """Whether this is a clearance that can be told: a number, though perhaps +inf, at a place of JSON values."""
    told = isinstance(clearance, Clearance) and isinstance(clearance.least, float | int)
    if not (told and isinstance(clearance.unit, str)):
        return False
    if math.isnan(clearance.least) or clearance.least == -math.inf or not isinstance(clearance.where, dict):
        return False
    try:
        json.dumps(clearance.where, allow_nan=False)
    except (TypeError, ValueError, RecursionError):
        return False
    return True


def next_attempt(problem: Problem, attempt: int) -> dict[str, Any] | None:
    """What ``problem.next_attempt`` returns.

    Raises:
        BadInput: if it raises, or returns neither None nor a table of plain JSON values.
    """
    try:
        fields = problem.next_attempt(attempt)
        return None if fields is None else _plain(problem, "next_attempt", fields)
    except EvaluationFailed as error:
        raise BadInput(str(error)) from None
    except _ANYTHING as error:
        raise BadInput(str(_raised(problem, "next_attempt", error))) from error


def _plain(problem: Problem, what: str, solution: Solution) -> Solution:
    try:
        plain: Any = json.loads(json.dumps(solution, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise EvaluationFailed(f"{problem.kind}: {what} must return plain JSON values: {error}") from error
    if not isinstance(plain, dict):
        raise EvaluationFailed(f"{problem.kind}: {what} must return a table of named values, got {shorten(plain)}")
    return plain


def _raised(problem: Problem, what: str, error: BaseException) -> EvaluationFailed:
    return EvaluationFailed(f"{problem.kind}: {what} raised {type(error).__name__}: {error}")
