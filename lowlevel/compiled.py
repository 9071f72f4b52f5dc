"""The decorators by which hot loops are compiled with numba, and the settings of numba for the whole program.

Kernels have explicit signatures. So importing a module compiles its kernels, or loads them from the cache on disk
(`lowlevel.kernel_cache`), and a process that is forked afterwards never compiles. Numba's default, to compile at the
first call, would make every node of a cluster compile for itself.
"""

import inspect
import os
from collections.abc import Callable
from typing import Any, TypeVar

# Results must not depend on whether Intel's vector mathematics (SVML) is installed. Numba reads the variable when it is
# imported, so it must be set before.
os.environ.setdefault("NUMBA_DISABLE_INTEL_SVML", "1")

import numba
from llvmlite import binding as llvm

from lowlevel.capabilities import capabilities
from lowlevel.kernel_cache import ModuleLocator, keep_kernels_of

if getattr(numba.config, "USING_SVML", False):  # another module imported numba before this project did
    raise ImportError("numba uses Intel SVML, whose results differ: set NUMBA_DISABLE_INTEL_SVML=1 and start again")

Function = TypeVar("Function", bound=Callable[..., Any])

_NUMBAS_LOCATORS = (
    "UserProvidedCacheLocator,InTreeCacheLocator,UserWideCacheLocator,IPythonCacheLocator,ZipCacheLocator"
)


def _use_our_cache() -> None:
    """Make numba ask this project's locator for cached code first, and then its own locators."""
    # Numba reloads its configuration when the environment has changed, and would then lose the setting that follows.
    numba.config.reload_config()  # type: ignore[no-untyped-call]
    locator = f"{ModuleLocator.__module__}.{ModuleLocator.__name__}"
    # By name, since numba creates this attribute only when it is imported.
    setattr(numba.config, "CACHE_LOCATOR_CLASSES", f"{locator},{_NUMBAS_LOCATORS}")  # noqa: B010


_use_our_cache()
if capabilities().numba_loader:
    from lowlevel.numba_loader import load_quickly

    load_quickly()


def processor() -> str:
    """Return LLVM's name of this processor, for which kernels are compiled."""
    return str(llvm.get_host_cpu_name())


def kernel(signature: Any, may_be_long: bool = False) -> Callable[[Function], Function]:
    """Return a decorator that compiles a function for ``signature`` now, or loads it from the cache.

    Fast-math stays off: it may reorder sums, and results would then depend on the machine.

    Args:
        signature: a text such as ``"void(float64[::1], int64)"``, or made of `numba.types` where no text can express
            it.
        may_be_long: whether the kernel releases the interpreter's lock (GIL) while it runs. Otherwise a node's network
            thread, which waits for the lock, would wake up in vain 200 times a second. Short kernels keep the lock.
    """
    compiler: Any = numba.njit(signature, cache=True, error_model="numpy", nogil=may_be_long)

    def compile_now(function: Function) -> Function:
        keep_kernels_of(inspect.getfile(function))
        compiled: Function = compiler(function)
        return compiled

    return compile_now


def c_function(signature: Any) -> Callable[[Function], Any]:
    """Return a decorator that compiles a function for callers in C, which call it by its ``address``."""
    compiler: Any = numba.cfunc(signature, cache=True, error_model="numpy")

    def compile_now(function: Function) -> Any:
        keep_kernels_of(inspect.getfile(function))
        return compiler(function)

    return compile_now


def subroutine(function: Function) -> Function:
    """Mark a function that only kernels call. It has no signature and is compiled into each kernel that uses it.

    It is not cached by itself: the cached kernel contains it. `lowlevel.kernel_cache` notices when it changes.
    """
    compiler: Any = numba.njit(error_model="numpy")
    compiled: Function = compiler(function)
    return compiled


def inlined(function: Function) -> Function:
    """Mark a `subroutine` that is inlined at each call, because LLVM does not vectorise a loop with a call in it.

    Vectorised results are still the same on every machine: without fast-math each lane computes exactly what scalar
    code would, so the width of a machine's registers does not matter.
    """
    compiler: Any = numba.njit(error_model="numpy", forceinline=True)
    compiled: Function = compiler(function)
    return compiled
