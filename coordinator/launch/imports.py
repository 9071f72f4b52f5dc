"""What the processes of a cluster import before they are forked, so that none imports or compiles it for itself."""

import importlib
from collections.abc import Collection

_OF_A_COORDINATOR = ("coordinator.service.launched", "sqlalchemy.dialects.sqlite", "sqlite3")


def import_all(kinds: Collection[str] | None = None, with_coordinator: bool = False) -> None:
    """Import everything that router, spy and nodes need, and perhaps what a coordinator needs.

    A coordinator that takes the place of a dead one has to share the cores with all nodes: it would import for seconds.

    Args:
        kinds: the kinds of problem whose compiled kernels are loaded; None for all.
        with_coordinator: whether a coordinator will be forked too.
    """
    import numpy.ma  # numba asks whether an array is one of these  # noqa: F401

    import coordinator.launch.router  # noqa: F401
    import node.process  # noqa: F401
    import problems.registry
    import spy.process  # noqa: F401
    from node.fingerprint import fingerprint

    if with_coordinator:
        for module in _OF_A_COORDINATOR:
            importlib.import_module(module)

    problems.registry.warm_up(kinds)
    fingerprint()
