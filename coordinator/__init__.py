"""Launch and supervise nodes, and run jobs on them.

Modules are imported when their names are first used: a client of a running cluster needs the errors, but not the
compiled kernels, which take long to load.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coordinator.cluster import LocalCluster
    from coordinator.errors import ClusterFailed
    from coordinator.job import Job

_HOMES = {"ClusterFailed": "coordinator.errors", "Job": "coordinator.job", "LocalCluster": "coordinator.cluster"}

__all__ = ["ClusterFailed", "Job", "LocalCluster"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'coordinator' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
