"""How hot loops are compiled: when their module is imported, once, and kept on disk.

Kernels carry explicit signatures, so that importing a module compiles it (or loads it from the cache) and a process
forked afterwards never compiles. Numba notices a change of a kernel's own file, but not of the kernels that it calls
in other files: a stale copy would silently break bit-identical replay. So the cache folder is named by a digest of all
sources that may hold kernels.
"""

import hashlib
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

# Bits must not depend on whether Intel's vector mathematics happens to be installed; numba asks when it is imported.
os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")

import numba

from genetics.quick_loading import load_quickly

if getattr(numba.config, "USING_SVML", False):  # somebody imported it before this project
    raise ImportError("numba uses Intel SVML, whose bits differ: set NUMBA_DISABLE_INTEL_SVML=1 before it is imported")

Function = TypeVar("Function", bound=Callable[..., Any])

_ROOT = Path(__file__).resolve().parent.parent
_PACKAGES = ("genetics", "problems", "wire", "node")  # `coordinator` has one kernel, that none of another file calls
_GENERATIONS_KEPT = 4


def _sources_digest() -> str:
    digest = hashlib.sha256(numba.__version__.encode())
    for package in _PACKAGES:
        for source in sorted((_ROOT / package).rglob("*.py")):
            status = source.stat()
            digest.update(f"{source}:{status.st_mtime_ns}:{status.st_size}\n".encode())
    return digest.hexdigest()[:16]


def _use_cache_of_these_sources() -> None:
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "supernode"
    folder = home / f"kernels-{_sources_digest()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        by_age = sorted(home.glob("kernels-*"), key=lambda path: path.stat().st_mtime, reverse=True)
    except OSError:
        return  # no home to write to: numba falls back to its own choice
    for old in by_age[_GENERATIONS_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)
    numba.config.reload_config()  # type: ignore[no-untyped-call] # else it would later, and forget what follows
    setattr(numba.config, "CACHE_DIR", str(folder))  # noqa: B010 - numba makes its settings when imported


_use_cache_of_these_sources()
load_quickly()


def kernel(signature: Any, may_be_long: bool = False) -> Callable[[Function], Function]:
    """Compile a function for ``signature`` now, or take it from the cache; no fast-math, so results are exact.

    A signature is a text such as ``"void(float64[::1], int64)"``, or made of `numba.types` where no text says it. While
    one that may be long runs, other threads may run Python: a node's network thread would wake up in vain 200 times a
    second otherwise.
    """
    compiler: Any = numba.njit(signature, cache=True, error_model="numpy", nogil=may_be_long)

    def compile_now(function: Function) -> Function:
        compiled: Function = compiler(function)
        return compiled

    return compile_now


def entry(function: Any) -> Callable[..., Any]:
    """The code of a kernel, without numba's look at the arguments: they must be of its signature's types exactly."""
    (compiled,) = function.overloads.values()
    code: Callable[..., Any] = compiled.entry_point
    return code


def c_function(signature: Any) -> Callable[[Function], Any]:
    """Compile a function that code in C calls by its ``address``."""
    compiler: Any = numba.cfunc
    compiled: Callable[[Function], Any] = compiler(signature, cache=True, error_model="numpy")
    return compiled


def subroutine(function: Function) -> Function:
    """A function that only kernels call; it is compiled into them."""
    compiler: Any = numba.njit(error_model="numpy")
    compiled: Function = compiler(function)
    return compiled


def inlined(function: Function) -> Function:
    """A `subroutine` that takes the place of its calls, because LLVM vectorises no loop with a call in it.

    Without fast-math a lane computes what one number alone would, so the width of a machine's registers shows nowhere.
    """
    compiler: Any = numba.njit(error_model="numpy", forceinline=True)
    compiled: Function = compiler(function)
    return compiled
