"""How the result of a run is shown: in words or as JSON, with a picture if one is wanted, and as an exit code."""

import argparse
import json
import math

from problems import ProblemFile
from spy.result import Result
from supernode import exits


def present(result: Result, file: ProblemFile, options: argparse.Namespace, interrupted: bool) -> int:
    """Print ``result`` on stdout, draw it if asked to, and return the exit code."""
    if options.json:
        print(json.dumps(result.to_json()))
    else:
        print(_words(result, file))
    if options.plot is not None and result.status != "failed":
        from supernode.picture import save_picture

        save_picture(result, file, options.plot)
        if not options.json:
            print(f"picture: {options.plot}")
    return exits.INTERRUPTED if interrupted else exit_code(result, file)


def exit_code(result: Result, file: ProblemFile) -> int:
    """0 if the target was reached, or there is none and the result is feasible."""
    if result.status == "failed":
        return exits.FAILED
    if result.solved:
        return exits.OK
    wanted = file.run.target is not None or file.problem().solved_at is not None
    return exits.NOT_REACHED if wanted or not result.feasible else exits.OK


def _words(result: Result, file: ProblemFile) -> str:
    lines = [_headline(result)]
    if result.message is not None:
        lines.append(f"  {result.message}")
    lines.append(
        f"  {result.generations:,} generations and {result.evaluations:,} evaluations in {result.seconds:.3f} s "
        f"on {result.nodes} nodes ({result.topology}, deme {result.deme}, {result.mode}, seed {result.seed})"
    )
    if result.solution is not None and result.status != "failed":
        lines += [f"  {line}" for line in file.problem().describe(result.solution).splitlines()]
    return "\n".join(lines)


def _headline(result: Result) -> str:
    if not math.isfinite(result.fitness) or result.found_at is None:
        return f"{result.status}: nothing feasible was found"
    place = ", ".join(str(part) for part in result.found_at["cell"])
    return (
        f"{result.status}: fitness {result.fitness:.6g}, "
        f"found by cell ({place}) in generation {result.found_at['generation']}"
    )
