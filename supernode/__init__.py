"""Supernode: robot motion planning by a genetic algorithm on a torus of real processes.

::

    import supernode

    with supernode.LocalCluster(torus=(4, 4)) as cluster:
        job = cluster.submit(supernode.load("examples/arm-ik.toml"), seed=1, seconds=5)
        for best in job.improvements():
            print(best.fitness, best.solution)
        result = job.result()

A user's own problem is a subclass of `Problem` that codes individuals by a `BitString` or a `RealVector`.

Names are imported when they are first used, so that ``supernode --help`` answers at once.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coordinator import ClusterFailed, Job, LocalCluster
    from genetics import BitString, RealVector, Recipe
    from problems import Answer, BadInput, Problem, ProblemFile, Table, Verdict, load, quantity
    from spy.result import Result
    from wire.news import Improvement

_HOMES = {
    "Answer": "problems",
    "BadInput": "problems",
    "BitString": "genetics",
    "ClusterFailed": "coordinator",
    "Improvement": "wire.news",
    "Job": "coordinator",
    "LocalCluster": "coordinator",
    "Problem": "problems",
    "ProblemFile": "problems",
    "RealVector": "genetics",
    "Recipe": "genetics",
    "Result": "spy.result",
    "Table": "problems",
    "Verdict": "problems",
    "load": "problems",
    "quantity": "problems",
}

__all__ = [
    "Answer",
    "BadInput",
    "BitString",
    "ClusterFailed",
    "Improvement",
    "Job",
    "LocalCluster",
    "Problem",
    "ProblemFile",
    "RealVector",
    "Recipe",
    "Result",
    "Table",
    "Verdict",
    "load",
    "quantity",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'supernode' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted(__all__)
