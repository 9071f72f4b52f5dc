"""What the processes of a cluster import before they are forked, so that none imports or compiles it for itself."""

from collections.abc import Collection


def import_all(kinds: Collection[str] | None = None, with_coordinator: bool = False) -> None:
    """Import everything that router, spy and nodes need, and perhaps what a coordinator needs.

    A coordinator that takes the place of a dead one has to share the cores with all nodes: it would import for seconds.

    Args:
        kinds: the kinds of problem whose compiled kernels are loaded; None for all.
        with_coordinator: whether a coordinator will be forked too.
    """
    import numpy.ma  # numba asks whether an array is one of these  # noqa: F401

    import coordinator.launch.router
    import node.process  # noqa: F401
    import problems.registry
    import spy.process  # noqa: F401
    from node.fingerprint import fingerprint

    if with_coordinator:
        import sqlite3  # noqa: F401

        import sqlalchemy.dialects.sqlite  # noqa: F401

        import coordinator.service.launched  # noqa: F401

    problems.registry.warm_up(kinds)
    fingerprint()
