"""Clocks of the kernel for compiled code: clock_gettime(2)."""

from typing import Any

from numba import types

from lowlevel.compiled import subroutine

_MONOTONIC, _THREAD_CPU = 1, 3
_clock_gettime: Any = types.ExternalFunction("clock_gettime", types.int32(types.int32, types.intp))


@subroutine
def monotonic_nanoseconds(time: Any) -> Any:
    """Return the monotonic clock; ``time`` is room for two int64 numbers, seconds and nanoseconds."""
    _clock_gettime(_MONOTONIC, time.ctypes.data)
    return time[0] * 1_000_000_000 + time[1]


@subroutine
def thread_nanoseconds(time: Any) -> Any:
    """Return the processor time that this thread has used; ``time`` is room for seconds and nanoseconds."""
    _clock_gettime(_THREAD_CPU, time.ctypes.data)
    return time[0] * 1_000_000_000 + time[1]
