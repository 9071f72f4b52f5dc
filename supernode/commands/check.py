"""Verify a result, or its solution alone, independently of the code that found it."""

import argparse
import contextlib
import json
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from supernode import exits

if TYPE_CHECKING:
    from problems import ProblemFile, Verdict

EXAMPLE = "supernode check examples/mobile-robot.toml result.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The problem and the result."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument("result", metavar="RESULT.json", help="a result as `solve --json` prints it, or its solution")
    parser.add_argument("--json", action="store_true", help="print the verdict as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Print whether the result is accepted, and what there is against it."""
    from problems import BadInput, load

    claim = _read(options.result)
    file = load(options.problem)
    try:
        with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
            fitness, objections = _judge(_as_it_was_run(file, claim), claim)
    except BadInput as error:
        if str(error).startswith(options.problem):
            raise
        raise BadInput(f"{options.result}: {error}") from error
    _print(options.json, objections, fitness)
    return exits.NOT_REACHED if objections else exits.OK


def _judge(file: "ProblemFile", claim: dict[str, Any]) -> tuple[float, list[str]]:
    """The fitness that the check finds, and all objections."""
    from problems.guard import checked

    solution = claim.get("solution", claim)
    if solution is None:
        return math.inf, ["there is no solution"]
    verdict = checked(file.problem(), solution)
    return verdict.fitness, [*verdict.objections, *_false_claims(claim, verdict, file)]


def _read(name: str) -> dict[str, Any]:
    from problems import BadInput

    try:
        claim = json.loads(Path(name).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{name}: expected a result, found {error.strerror}") from error
    except ValueError as error:
        raise BadInput(f"{name}: expected JSON, found {error}") from error
    if not isinstance(claim, dict):
        raise BadInput(f"{name}: expected a JSON object, found {type(claim).__name__}")
    return claim


def _as_it_was_run(file: "ProblemFile", claim: dict[str, Any]) -> "ProblemFile":
    """A whole result says by which recipe it was found, which may decide how bits are read."""
    settings = claim.get("run")
    if not isinstance(settings, dict):
        return file
    known = {name: settings[name] for name in ("recipe", "deme", "target") if name in settings}
    return file.with_run(**known)


def _false_claims(claim: dict[str, Any], verdict: "Verdict", file: "ProblemFile") -> list[str]:
    """What a whole result says beside its solution, and is not so."""
    from problems.guard import solved_at
    from spy.judge import same_fitness

    false = []
    claimed = claim.get("fitness", verdict.fitness)
    claimed = math.inf if claimed is None else claimed
    if not isinstance(claimed, float | int) or not same_fitness(claimed, verdict.fitness):
        false.append(f"the result claims a fitness of {claimed}, the check finds {verdict.fitness:.9g}")
    if claim.get("problem_sha256", file.sha256) != file.sha256:
        false.append("the result is of another problem: problem_sha256 differs")
    target = file.run.target if file.run.target is not None else solved_at(file.problem())
    solved = target is None or verdict.fitness <= target or same_fitness(verdict.fitness, target)
    if claim.get("solved") is True and not solved:
        false.append(f"the result claims to be solved, the target is {target}")
    return false


def _print(as_json: bool, objections: list[str], fitness: float) -> None:
    if as_json:
        finite = fitness if math.isfinite(fitness) else None
        print(json.dumps({"accepted": not objections, "fitness": finite, "objections": objections}))
    elif objections:
        print("rejected: " + "; ".join(objections))
    else:
        print(f"accepted: fitness {fitness:.6g}")
