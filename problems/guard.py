"""Call the methods of problems, which may be a user's own code, and validate what they return.

Whatever a method does, the caller gets a value of the expected type or one exception with a clear message.
"""

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from genetics.arrays import Evaluate, Fitness, Genomes
from problems.animation import Animation
from problems.errors import BadInput, EvaluationFailed, one_line, shorten
from problems.motion import Motion, Pace
from problems.problem import MOST_REPORT_BYTES, Answer, Clearance, Problem, Solution, Verdict
from problems.run import Run

_ANYTHING = (Exception, SystemExit)  # a user's code may call sys.exit; KeyboardInterrupt still ends the process


def guarded(problem: Problem) -> Evaluate:
    """Return a guarded version of ``problem.evaluate``.

    It raises `EvaluationFailed` if the method raises, returns NaN or -inf, or not one value for each genome.
    """
    return soundly(problem, lambda genomes: evaluated(problem, genomes))


def evaluated(problem: Problem, genomes: Genomes) -> Fitness:
    """Call ``problem.evaluate`` and return one number of any value for each genome. This loads no kernels.

    Raises:
        EvaluationFailed: if the method raises, or returns anything else.
    """
    try:
        # Copy: the returned array may be read-only, or a buffer that the problem will reuse.
        fitness = np.array(problem.evaluate(genomes), dtype=np.float64, order="C")
    except _ANYTHING as error:
        raise _raised(problem, "evaluate", error) from error
    if fitness.shape != (len(genomes),):
        raise EvaluationFailed(
            f"{problem.kind}: evaluate must return an array of shape ({len(genomes)},), got {fitness.shape}"
        )
    return fitness


def soundly(problem: Problem, evaluate: Evaluate) -> Evaluate:
    """Return a function that calls ``evaluate``, see `evaluated`, and raises `EvaluationFailed` for NaN or -inf."""
    from genetics.selection import unsound

    def sound(genomes: Genomes) -> Fitness:
        fitness = evaluate(genomes)
        if (wrong := unsound(fitness)) >= 0:
            raise EvaluationFailed(
                f"{problem.kind}: evaluate must not return NaN or -inf, got {fitness[wrong]}"
                f" for genome {genomes[wrong].tobytes().hex()}"
            )
        return fitness

    return sound


def decoded(problem: Problem, genome: Genomes) -> Solution:
    """Call ``problem.decode`` and return the solution.

    Raises:
        EvaluationFailed: if the method raises, or does not return a dict of plain JSON values.
    """
    try:
        solution = problem.decode(genome)
    except _ANYTHING as error:
        raise _raised(problem, "decode", error) from error
    return _plain(problem, "decode", solution)


def reported(problem: Problem) -> bytes:
    """Call ``problem.report`` and return the report.

    Raises:
        EvaluationFailed: if the method raises, or does not return at most `MOST_REPORT_BYTES` bytes.
    """
    try:
        report = problem.report()
    except _ANYTHING as error:
        raise _raised(problem, "report", error) from error
    if not isinstance(report, bytes) or len(report) > MOST_REPORT_BYTES:
        raise EvaluationFailed(f"{problem.kind}: report must return at most {MOST_REPORT_BYTES} bytes")
    return report


def merged(problem: Problem, solution: Solution, reports: Mapping[int, bytes], finder: int) -> Solution:
    """Call ``problem.merge`` and return the completed solution.

    Raises:
        EvaluationFailed: if the method raises, or does not return a dict of plain JSON values.
    """
    try:
        whole = problem.merge(solution, reports, finder)
    except _ANYTHING as error:
        raise _raised(problem, "merge", error) from error
    return _plain(problem, "merge", whole)


def checked(problem: Problem, solution: Solution) -> Verdict:
    """Call ``problem.check`` and return the verdict.

    Raises:
        BadInput: if the method raises it, because ``solution`` is not in the format of this kind of problem.
        EvaluationFailed: if the method raises anything else, or returns no valid `Verdict`.
    """
    try:
        verdict = problem.check(solution)
    except BadInput:
        raise
    except _ANYTHING as error:
        raise _raised(problem, "check", error) from error
    # Type annotations do not bind a user's class, so test what was actually returned.
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
    """Return a verdict's clearance in the format of results.

    Returns:
        ``"least"`` (None if there is nothing to come close to), ``"where"``, ``"required"`` (the problem's field
        ``clearance``, or 0) and the ``"unit"`` of both; None if the verdict has no clearance.
    """
    clearance = verdict.clearance
    if clearance is None:
        return None
    required = getattr(problem, "clearance", 0.0)
    return {
        # JSON has no infinity.
        "least": float(clearance.least) if math.isfinite(clearance.least) else None,
        "where": clearance.where,
        "required": float(required) if isinstance(required, float | int) else 0.0,
        "unit": clearance.unit,
    }


def oracle_answer(problem: Problem) -> Answer:
    """Call ``problem.oracle`` and return its answer.

    Raises:
        BadInput: if there is no oracle for this problem.
        EvaluationFailed: if the method raises anything else, or returns no valid `Answer`.
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
    """Call ``problem.motion`` and return the motion, or None if solutions of this kind are no motions.

    Raises:
        BadInput: if ``pace`` does not suit the solution.
        EvaluationFailed: if the method raises anything else, or returns no valid motion of finite numbers.
    """
    try:
        # Extreme speeds overflow; the error that matters, too many rows, is raised without numpy's warnings.
        with np.errstate(all="ignore"):
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


def retimed(problem: Problem, solution: Solution, pace: Pace) -> Solution:
    """Call ``problem.retimed`` and return the solution, if ``problem.check`` accepts it.

    Raises:
        BadInput: if the solution cannot be retimed, or the check objects to what came of it.
        EvaluationFailed: if a method raises anything else, or does not return a dict of plain JSON values.
    """
    try:
        timed = problem.retimed(solution, pace)
    except BadInput:
        raise
    except _ANYTHING as error:
        raise _raised(problem, "retimed", error) from error
    timed = _plain(problem, "retimed", timed)
    objections = checked(problem, timed).objections
    if objections:
        raise BadInput(f"--retime: expected a motion that the check accepts, found one where {objections[0]}")
    return timed


def animated(problem: Problem, solution: Solution | None) -> Animation | None:
    """Call ``problem.animation`` and return the animation, or None if this kind of problem has none.

    Raises:
        BadInput: if the method raises it.
        EvaluationFailed: if the method raises anything else, or returns no sound animation.
    """
    try:
        animation = problem.animation(solution)
        complaint = None if animation is None else animation.complaint()
    except BadInput:
        raise
    except _ANYTHING as error:
        raise _raised(problem, "animation", error) from error
    if complaint is not None:
        raise EvaluationFailed(f"{problem.kind}: animation must return {complaint}")
    return animation


def described(problem: Problem, solution: Solution) -> str:
    """Call ``problem.describe``; fall back to `Problem.describe` if it raises or returns no text.

    A solution that was found must not be lost because it cannot be described.
    """
    try:
        words = problem.describe(solution)
    except _ANYTHING:
        words = ""
    return words if isinstance(words, str) and words else Problem.describe(problem, solution)


def advised(problem: Problem, found: Solution | None, run: Run) -> tuple[str, ...]:
    """Call ``problem.advice`` and return its lines; none if the method raises."""
    try:
        # Advice is a courtesy: a failure here must not change the outcome of a run.
        lines = [one_line(each) for each in problem.advice(found, run) if isinstance(each, str) and each]
    except _ANYTHING:
        return ()
    return tuple(lines)


def solved_at(problem: Problem) -> float | None:
    """Return ``problem.solved_at``.

    Raises:
        BadInput: if the property raises, or is neither a number nor None.
    """
    try:
        fitness = problem.solved_at
    except _ANYTHING as error:
        raise BadInput(f"{problem.kind}: solved_at raised {type(error).__name__}: {error}") from error
    if fitness is None:
        return None
    # Python counts True and False as numbers, but as a target they are a mistake.
    if isinstance(fitness, bool) or not isinstance(fitness, float | int | np.floating) or math.isnan(fitness):
        raise BadInput(f"{problem.kind}: solved_at must be a number or None, got {fitness!r}")
    return float(fitness)


def solved_when(problem: Problem) -> str | None:
    """Return ``problem.solved_when`` in one line; None if it raises or is no text."""
    try:
        words = problem.solved_when
    except _ANYTHING:
        return None
    return one_line(words) if isinstance(words, str) and words else None


def _is_measured(clearance: Any) -> bool:
    """Return whether this is a valid clearance: a number or +inf, a text as unit, and a place of JSON values."""
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
    """Call ``problem.next_attempt`` and return the fields to change, or None.

    Raises:
        BadInput: if the method raises, or returns neither None nor a dict of plain JSON values.
    """
    try:
        fields = problem.next_attempt(attempt)
        return None if fields is None else _plain(problem, "next_attempt", fields)
    except EvaluationFailed as error:
        raise BadInput(str(error)) from None
    except _ANYTHING as error:
        raise BadInput(str(_raised(problem, "next_attempt", error))) from error


def _plain(problem: Problem, what: str, solution: Solution) -> Solution:
    """Return a copy of the ``solution`` that the method ``what`` has returned, as it will be after a trip as JSON."""
    try:
        plain: Any = json.loads(json.dumps(solution, allow_nan=False))
    except (TypeError, ValueError, RecursionError) as error:
        raise EvaluationFailed(f"{problem.kind}: {what} must return plain JSON values: {error}") from error
    if not isinstance(plain, dict):
        raise EvaluationFailed(f"{problem.kind}: {what} must return a table of named values, got {shorten(plain)}")
    return plain


def _raised(problem: Problem, what: str, error: BaseException) -> EvaluationFailed:
    return EvaluationFailed(f"{problem.kind}: {what} raised {type(error).__name__}: {error}")
