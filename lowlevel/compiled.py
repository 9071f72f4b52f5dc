"""How hot loops are compiled: when their module is imported, once, and kept on disk (`lowlevel.kernel_cache`).

Kernels carry explicit signatures, so that importing a module compiles it (or loads it from the cache) and a process
forked afterwards never compiles.
"""

import inspect
import os
from collections.abc import Callable
from typing import Any, TypeVar

# Bits must not depend on whether Intel's vector mathematics happens to be installed; numba asks when it is imported.
os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")

import numba

from lowlevel.capabilities import capabilities
from lowlevel.kernel_cache import ModuleLocator, keep_kernels_of

if getattr(numba.config, "USING_SVML", False):  # somebody imported it before this project
    raise ImportError("numba uses Intel SVML, whose bits differ: set NUMBA_DISABLE_INTEL_SVML=1 before it is imported")

Function = TypeVar("Function", bound=Callable[..., Any])

_NUMBAS_LOCATORS = (
    "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator,ZipCacheLocator"
)


def _use_our_cache() -> None:
    """Ask this project's locator first; if it knows nothing of a function, numba's own ones."""
    numba.config.reload_config()  # type: ignore[no-untyped-call] # else it would later, and forget what follows
    locator = f"{ModuleLocator.__module__}.{ModuleLocator.__name__}"
    setattr(numba.config, "CACHE_LOCATOR_CLASSES", f"{locator},{_NUMBAS_LOCATORS}")  # noqa: B010 - made when imported


_use_our_cache()
if capabilities().numba_loader:
    from lowlevel.numba_loader import load_quickly

    load_quickly()


def kernel(signature: Any, may_be_long: bool = False) -> Callable[[Function], Function]:
    """Compile a function for ``signature`` now, or take it from the cache; no fast-math, so results are exact.

    A signature is a text such as ``"void(float64[::1], int64)"``, or made of `numba.types` where no text says it. While
    one that may be long runs, other threads may run Python: a node's network thread would wake up in vain 200 times a
    second otherwise.
    """
    compiler: Any = numba.njit(signature, cache=True, error_model="numpy", nogil=may_be_long)

    def compile_now(function: Function) -> Function:
        keep_kernels_of(inspect.getfile(function))
        compiled: Function = compiler(function)
        return compiled

    return compile_now


def c_function(signature: Any) -> Callable[[Function], Any]:
    """Compile a function that code in C calls by its ``address``."""
    compiler: Any = numba.cfunc(signature, cache=True, error_model="numpy")

    def compile_now(function: Function) -> Any:
        keep_kernels_of(inspect.getfile(function))
        return compiler(function)

    return compile_now


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
