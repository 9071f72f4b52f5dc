"""Present the result of a run: in words or as JSON, with a picture if one is wanted, and as an exit code."""

import argparse
import contextlib
import json
import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from problems import BadInput, EvaluationFailed, ProblemFile, Run
from problems.run import DEFAULT_STALL
from spy.result import Result
from supernode import exits
from wire.printable import printable_lines


def present(result: Result, file: ProblemFile, options: argparse.Namespace, interrupted: bool) -> int:
    """Print ``result`` on stdout, retimed and drawn if asked to, and return the exit code."""
    if getattr(options, "retime", False):
        result = _retimed(result, file)
    if options.json:
        print(json.dumps(result.to_json()))
    else:
        print(printable_lines(_words(result)))
    if result.status == "failed":
        print(f"error: {printable_lines(str(result.message))}", file=sys.stderr)
    elif options.plot is not None:
        _draw(result, file, options.plot)
    return exits.INTERRUPTED if interrupted else exit_code(result)


def _retimed(result: Result, file: ProblemFile) -> Result:
    """Return the result with times; a path that cannot have them still counts."""
    from problems.guard import retimed
    from problems.motion import Pace

    if result.solution is None:
        return result
    try:
        with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
            timed = retimed(file.problem(), result.solution, Pace())
    except (BadInput, EvaluationFailed) as error:
        print(f"warning: no times: {printable_lines(str(error))}", file=sys.stderr)
        return result
    print(f"retimed: {timed['trajectory']['t'][-1]:.3f} s", file=sys.stderr)
    return replace(result, solution=timed)


def _draw(result: Result, file: ProblemFile, name: str) -> None:
    """Draw the result; the picture is an extra, so a result without one still counts."""
    from supernode.pictures.picture import save_picture

    try:
        with contextlib.redirect_stdout(sys.stderr):  # a user's module may print
            save_picture(result, file, name)
    except BadInput as error:
        print(f"warning: no picture: {printable_lines(str(error))}", file=sys.stderr)
    else:
        print(f"picture: {name}", file=sys.stderr)


def exit_code(result: Result) -> int:
    """Return the exit code: 0 if the target was reached, or if there is none and the result is feasible."""
    if result.status == "failed":
        return exits.FAILED
    if result.solved:
        return exits.OK
    return exits.NOT_REACHED if result.target is not None or not result.feasible else exits.OK


def _words(result: Result) -> str:
    lines = [headline(result)]
    if result.oracle is not None:
        lines.append(f"  {result.oracle}")
    if result.message is not None:
        lines.append(f"  {result.message}")
    lines.append(
        f"  {result.generations:,} generations and {result.evaluations:,} evaluations in {result.seconds:.3f} s "
        f"on {result.nodes} nodes ({result.topology}, deme {result.deme}, {result.mode}, seed {result.seed})"
    )
    if restarts := sum(each["do"] == "retry" for each in result.directives):
        lines.append(f"  restarts after a stall: {restarts}")
    if result.staleness is not None:
        lines.append(
            f"  immigrants were {result.staleness['mean']:.2f} generations behind on average, at most "
            f"{result.staleness['max']:,}; {result.staleness['again']:.0%} had been bred with before"
        )
    if result.solved_when is not None:
        target = (
            "no target"
            if result.target is None
            else f"{'solved' if result.solved else 'would be solved'} at {result.target:.4g}"
        )
        lines.append(f"  {target}: {result.solved_when}")
    lines += [f"  {line}" for line in result.advice]
    if result.clearance is not None:
        lines.append(f"  {clearance_words(result.clearance)}")
    if result.words is not None:
        lines += [f"  {line}" for line in result.words.splitlines()]
    return "\n".join(lines)


def clearance_words(clearance: Mapping[str, Any]) -> str:
    """Return the clearance in words, such as ``"least clearance 0.031 m (0.02 m required), at link 2, obstacle 0"``."""
    unit = f" {clearance['unit']}" if clearance["unit"] else ""
    least = "nothing to come close to"
    if clearance["least"] is not None:
        least = f"least clearance {round(clearance['least'], 6) + 0.0:.3g}{unit}"
    required = f" ({clearance['required']:g}{unit} required)" if clearance["required"] else ""
    where = ", ".join(f"{name} {_short(value)}" for name, value in clearance["where"].items())
    return f"{least}{required}{', at ' + where if where else ''}"


def _short(value: object) -> str:
    """Return plain values as text with as many digits as people read."""
    if isinstance(value, list):
        return f"[{', '.join(_short(each) for each in value)}]"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def headline(result: Result) -> str:
    """Return how the run ended, in a line."""
    if result.found is None and result.evaluations == 0 and result.status in ("deadline", "cancelled"):
        return f"{result.status}: it was still waiting for nodes, and never ran"
    if not math.isfinite(result.fitness) or result.found_at is None:
        return f"{result.status}: nothing feasible was found"
    place = ", ".join(str(part) for part in result.found_at["cell"])
    epoch = f" of epoch {result.found_at['epoch']}" if result.found_at.get("epoch") else ""
    found = (
        f"fitness {result.fitness:.6g}, found by cell ({place}) in generation {result.found_at['generation']}{epoch}"
    )
    status: str = result.status
    if status == "stalled" and result.feasible and result.target is None:  # a run without a target normally ends so
        status = f"stalled, nothing better for {_stall(result)} generations"
    return f"{status}: {found if result.feasible else f'no solution; the best attempt has {found}'}"


def _stall(result: Result) -> int:
    return Run(**result.run).stall_limit() or DEFAULT_STALL
