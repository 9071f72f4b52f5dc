"""What bit-identical replay depends on: nodes that differ here must not share a lockstep run."""

import platform
from functools import cache
from importlib.metadata import version

import llvmlite.binding


@cache
def fingerprint() -> dict[str, str]:
    """Versions and processor of this process."""
    return {
        "supernode": version("supernode"),
        "python": platform.python_version(),
        "numpy": version("numpy"),
        "numba": version("numba"),
        "libc": " ".join(platform.libc_ver()),
        "cpu": str(llvmlite.binding.get_host_cpu_name()),
    }
