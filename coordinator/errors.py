"""The exception for failures of a cluster."""


class ClusterFailed(RuntimeError):  # noqa: N818
    """The cluster, or one of its processes, failed; the message says which process and why, as far as that is known."""
