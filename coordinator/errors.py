"""What can go wrong with a cluster."""


class ClusterFailed(RuntimeError):  # noqa: N818
    """A process of the cluster died, or did not come up; the message names the cell."""
