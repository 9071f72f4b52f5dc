"""Which low-level parts are safe to use in this process, and why the others are not."""

import os
import platform
import sys
import sysconfig
from collections.abc import Collection, Mapping
from functools import cache
from typing import NamedTuple

PLAIN = "SUPERNODE_PLAIN"
"""The environment variable that turns all of them off when it is "1"; or those that it names, such as "c_api,linux"."""
_NUMBA = ("0.68",)  # minor versions whose private parts were looked at, and with which the tests passed
_MACHINES = ("x86_64", "aarch64")


class Capabilities(NamedTuple):
    """Whether each part may be used here.

    Attributes:
        numba_loader: kernels load without what only compiling them needs.
        numba_calls: compiled code calls a kernel by its address, so that one call carries out whole generations.
        c_api: compiled code is called by Zenoh, and calls CPython's C API, so that no Python runs in an exchange.
        fork_memory: the zygote arranges its memory so that a fork has little to copy.
        linux: threads ask the kernel for the length of their turns, and processes for a signal when their parent dies.
        reasons: for each part that may not be used, why.
    """

    numba_loader: bool
    numba_calls: bool
    c_api: bool
    fork_memory: bool
    linux: bool
    reasons: Mapping[str, str]


@cache
def capabilities() -> Capabilities:
    """Look at the environment, the interpreter, numba, the C library and the kernel, once for each process.

    Raises:
        ValueError: if the environment names a part that does not exist.
    """
    numba, python, linux, c_library = _of_numba(), _of_python(), _of_linux(), _of_c_library()
    reasons = {
        "numba_loader": numba,
        "numba_calls": numba,
        "c_api": numba or python,
        "fork_memory": python or linux or c_library,
        "linux": linux,
    }
    reasons |= dict.fromkeys(turned_off(), f"{PLAIN}={os.environ.get(PLAIN)}")
    if reasons["numba_calls"]:  # the callbacks breed whole generations
        reasons["c_api"] = reasons["c_api"] or reasons["numba_calls"]
    refused = {part: reason for part, reason in reasons.items() if reason}
    return Capabilities(**{part: part not in refused for part in reasons}, reasons=refused)


def turned_off() -> Collection[str]:
    """Return the parts that the environment turns off.

    Raises:
        ValueError: if it names a part that does not exist: a misspelt name would otherwise turn nothing off.
    """
    parts = [part for part in Capabilities._fields if part != "reasons"]
    chosen = os.environ.get(PLAIN, "")
    if chosen == "1":
        return parts
    named = [part for part in map(str.strip, chosen.split(",")) if part]
    for part in named:
        if part not in parts:
            raise ValueError(f"{PLAIN}: expected 1 for all parts, or names from {', '.join(parts)}, found {part!r}")
    return named


def _of_numba() -> str:
    from importlib.metadata import version  # here, since clients never ask, and it takes milliseconds

    found = version("numba")
    minor = ".".join(found.split(".")[:2])
    return "" if minor in _NUMBA else f"numba {found} is none of {', '.join(_NUMBA)}"


def _of_python() -> str:
    if sys.implementation.name != "cpython":
        return f"{sys.implementation.name} is not CPython"
    if sysconfig.get_config_var("Py_GIL_DISABLED"):
        return "this CPython has no global interpreter lock"
    return ""


def _of_c_library() -> str:
    name, _ = platform.libc_ver()
    return "" if name == "glibc" else f"the C library is {name or 'unknown'}, not glibc"


def _of_linux() -> str:
    system = platform.system()
    if system != "Linux":
        return f"{system} is not Linux"
    machine = platform.machine()
    return "" if machine in _MACHINES else f"{machine} is none of {', '.join(_MACHINES)}"
