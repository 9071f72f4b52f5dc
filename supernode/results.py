"""From what the cluster keeps of a job that has ended to a `Result`."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from coordinator.errors import ClusterFailed
from spy.result import Result


def result_in(view: Mapping[str, Any]) -> Result:
    """The result of a job that has ended.

    Raises:
        ClusterFailed: if it ended without any: it never ran.
    """
    values = view["result"]
    if values is None:
        raise ClusterFailed(f"job {view['job']}: {view['status']}: {view.get('message') or 'it did not run'}")
    known = {field.name for field in dataclasses.fields(Result)}
    given = {name: value for name, value in values.items() if name in known}
    if given.get("fitness") is None:
        given["fitness"] = math.inf
    try:
        return Result(**given)
    except TypeError as error:
        raise ClusterFailed(f"job {view['job']}: its result cannot be read: {error}") from error
