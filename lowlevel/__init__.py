"""All code that relies on private parts of numba, CPython, the C library or Linux; each has an ordinary path beside it.

`capabilities` says which of these parts are safe to use in this process. Where one is not, its caller takes the
ordinary path: the same results, slower. ``SUPERNODE_PLAIN=1`` in the environment turns all of them off.
docs/performance.md has what each brings.

`compiled` and `kernel_cache` are here too, since everything else is built on them: how kernels are compiled, and where
they are kept.
"""

from lowlevel.capabilities import Capabilities, capabilities

__all__ = ["Capabilities", "capabilities"]
