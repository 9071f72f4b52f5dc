"""Read results: from files, and from what a cluster keeps of a job that has ended."""

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import topologies
from coordinator.errors import ClusterFailed
from problems import BadInput, ProblemFile
from problems.errors import shorten
from spy.result import Result
from topologies import Topology


def read_table(name: str) -> dict[str, Any]:
    """Return the JSON object in the file of a result, or of its solution alone.

    Raises:
        BadInput: names the file if it cannot be read or holds no JSON object.
    """
    try:
        found = json.loads(Path(name).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{name}: expected a result, found {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{name}: expected JSON, found {error}") from None
    if not isinstance(found, dict):
        raise BadInput(f"{name}: expected a result, found {shorten(found)}")
    return found


def result_in(view: Mapping[str, Any]) -> Result:
    """Return the result of a job that has ended; for a job that never ran, a result without an answer.

    Args:
        view: the answer to `show` about the job.

    Raises:
        ClusterFailed: if the result cannot be read.
    """
    values = _nothing(view) if view["result"] is None else view["result"]
    # A coordinator of another version may send more fields: ignore those that this version does not know.
    known = {field.name for field in dataclasses.fields(Result)}
    given = {name: value for name, value in values.items() if name in known}
    if given.get("fitness") is None:
        given["fitness"] = math.inf
    try:
        return Result(**given)
    except TypeError as error:
        raise ClusterFailed(f"job {view['job']}: its result cannot be read: {error}") from error


def topology_of(view: Mapping[str, Any], epoch: int) -> Topology:
    """Return the topology that a job had in an epoch; ``view`` is the answer to `show` about the job."""
    spec = ProblemFile.from_json(view["file"]).run.topology
    if view["epochs"] and view["epochs"][0]["epoch"] > 1:  # the first epochs are forgotten: assume today's topology
        spec = view["topology"]
    for change in view["epochs"]:
        if change["epoch"] <= epoch:
            spec = change.get("topology", spec)
    return topologies.parse(spec)


def _nothing(view: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields of a result for a job that never ran or whose result is lost, with its best answer if any."""
    file = ProblemFile.from_json(view["file"])
    topology = topologies.parse(file.run.topology)
    whole = dict.fromkeys(("generations", "evaluations"), 0)
    seconds = dict.fromkeys(("seconds", "seconds_to_ready", "cpu_seconds"), 0.0)
    absent = dict.fromkeys(("fitness", "solution", "found_at", "staleness", "history_sha256"))
    return {
        "job": view["job"],
        "kind": file.kind,
        "status": view["status"],
        "solved": False,
        "feasible": False,
        "nodes": topology.cells,
        "topology": topology.spec,
        "deme": file.run.deme,
        "mode": file.run.mode,
        "seed": file.run.seed,
        "run": file.run.model_dump(),
        "problem_sha256": file.sha256,
        "versions": {},
        "directives": [],
        "messages": dict.fromkeys(("sent", "received", "lost", "rejected"), 0),
        "message": view.get("message"),
        **whole,
        **seconds,
        **absent,
        **_known(view["best"]),
    }


def _known(best: Mapping[str, Any] | None) -> dict[str, Any]:
    """Return the fields of a result that describe the best answer, as `show` holds it."""
    if best is None:
        return {}
    name = "solution" if best["feasible"] else "best_attempt"
    return {"fitness": best["fitness"], "feasible": best["feasible"], name: best["solution"]}
