"""What the processes of a cluster import before they are forked, so that none imports or compiles it for itself."""

from collections.abc import Collection


def import_all(kinds: Collection[str] | None = None) -> None:
    """Import everything that router, spy and nodes need, with the compiled kernels of these kinds (None: of all)."""
    import numpy.ma  # numba asks whether an array is one of these  # noqa: F401

    import node.process  # noqa: F401
    import problems.registry
    import spy.process  # noqa: F401
    from node.fingerprint import fingerprint

    problems.registry.warm_up(kinds)
    fingerprint()
