"""Launch and supervise nodes, and run jobs on them.

Each subpackage has a docstring that says what happens in it, and which module to read first. A subpackage imports only
from those above it in this list, and from the modules beside them (`errors`, `threads`, `cpu_time`, `log_lines`):

- `jobs`: give free nodes to queued jobs, and conduct each job from its first epoch to its result
- `store`: keep jobs and records in a database, so that another coordinator can go on
- `service`: answer clients, in a process that runs jobs on nodes which other processes have launched
- `launch`: start the processes on a machine, replace those that die, and end them
- `experiments`: run many jobs on clusters of several sizes, and report what they cost

Modules are imported when their names are first used: a client of a running cluster needs the errors, but not the
compiled kernels, which take long to load.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from coordinator.errors import ClusterFailed
    from coordinator.jobs.job import Job
    from coordinator.launch.cluster import LocalCluster

_HOMES = {
    "ClusterFailed": "coordinator.errors",
    "Job": "coordinator.jobs.job",
    "LocalCluster": "coordinator.launch.cluster",
}

__all__ = ["ClusterFailed", "Job", "LocalCluster"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'coordinator' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)
