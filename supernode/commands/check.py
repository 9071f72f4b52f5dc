"""Verify a result, or its solution alone, independently of the code that found it."""

import argparse
import json
import math

from supernode import exits

EXAMPLE = "supernode check examples/mobile-robot.toml result.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The problem and the result."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument("result", metavar="RESULT.json", help="a result as `solve --json` prints it, or its solution")
    parser.add_argument("--json", action="store_true", help="print the verdict as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Print whether the result is accepted, and what there is against it."""
    from problems import load
    from supernode.claims import judged

    judgement = judged(load(options.problem), options.result)
    _print(options.json, judgement.objections, judgement.fitness)
    return exits.NOT_REACHED if judgement.objections else exits.OK


def _print(as_json: bool, objections: list[str], fitness: float) -> None:
    if as_json:
        finite = fitness if math.isfinite(fitness) else None
        print(json.dumps({"accepted": not objections, "fitness": finite, "objections": objections}))
    elif objections:
        print("rejected: " + "; ".join(objections))
    else:
        print(f"accepted: fitness {fitness:.6g}")
