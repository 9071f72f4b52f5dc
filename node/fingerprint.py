"""The fingerprint of a process: what bit-identical replay depends on, and so the same for all nodes of a run."""

import platform
from functools import cache
from importlib.metadata import version


@cache
def fingerprint() -> dict[str, str]:
    """Return the versions of this process's software, and its processor, for which LLVM generates code."""
    from lowlevel.compiled import processor  # not above: numba takes half a second, and most commands need none

    return {
        "supernode": version("supernode"),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "libc": " ".join(platform.libc_ver()),
        "cpu": processor(),
    }
