"""Launch and supervise nodes, and take jobs."""

from coordinator.cluster import LocalCluster
from coordinator.errors import ClusterFailed
from coordinator.job import Job

__all__ = ["ClusterFailed", "Job", "LocalCluster"]
