"""Verify a result, or its solution alone, independently of the code that found it."""

import argparse
import json
import math
from typing import TYPE_CHECKING, Any

from supernode import exits

if TYPE_CHECKING:
    from supernode.runs.claims import Judgement

EXAMPLE = "supernode check examples/mobile-robot.toml result.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the problem and the result."""
    parser.add_argument("problem", metavar="PROBLEM.toml", help="the problem file")
    parser.add_argument("result", metavar="RESULT.json", help="a result as `solve --json` prints it, or its solution")
    parser.add_argument("--json", action="store_true", help="print the verdict as one JSON object")


def run(options: argparse.Namespace) -> int:
    """Print whether the check accepts the result, and the objections if not."""
    from problems import load
    from supernode.runs.claims import verified

    judgement = verified(load(options.problem), options.result)
    print(json.dumps(_plain(judgement)) if options.json else _words(judgement))
    return exits.NOT_REACHED if judgement.objections else exits.OK


def _plain(judgement: "Judgement") -> dict[str, Any]:
    return {
        "accepted": not judgement.objections,
        "fitness": judgement.fitness if math.isfinite(judgement.fitness) else None,
        "objections": judgement.objections,
        "clearance": judgement.clearance,
    }


def _words(judgement: "Judgement") -> str:
    from supernode.terminal.present import clearance_words

    if judgement.objections:
        return "rejected: " + "; ".join(judgement.objections)
    clearance = "" if judgement.clearance is None else f", {clearance_words(judgement.clearance)}"
    return f"accepted: fitness {judgement.fitness:.6g}{clearance}"
