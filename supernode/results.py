"""From what the cluster keeps of a job that has ended to a `Result`."""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from coordinator.errors import ClusterFailed
from node.fingerprint import fingerprint
from problems import ProblemFile
from spy.judge import Judgement
from spy.result import Clocks, Lived, Result, result_of


def result_in(view: Mapping[str, Any]) -> Result:
    """The result of a job that has ended; of one that never ran, one without an answer.

    Args:
        view: what `show` tells of the job.

    Raises:
        ClusterFailed: if it cannot be read.
    """
    values = view["result"]
    if values is None:
        return _without_run(view)
    known = {field.name for field in dataclasses.fields(Result)}
    given = {name: value for name, value in values.items() if name in known}
    if given.get("fitness") is None:
        given["fitness"] = math.inf
    try:
        return Result(**given)
    except TypeError as error:
        raise ClusterFailed(f"job {view['job']}: its result cannot be read: {error}") from error


def _without_run(view: Mapping[str, Any]) -> Result:
    judgement = Judgement(view["status"], False, view.get("message"), None)
    file = ProblemFile.from_json(view["file"])
    blank = result_of(view["job"], [Lived(file)], judgement, fingerprint(), Clocks(0.0, 0.0, 0.0))
    return replace(blank, history_sha256=None)
