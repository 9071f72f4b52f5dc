"""What a process does about its memory before it forks, so that its children have little to copy.

A child copies each page that it writes to, and a fork an entry for each page of anonymous memory: most of what a
thousand nodes cost at their start, above all on a virtual machine whose host must first find the pages.
"""

import contextlib
import ctypes
import mmap
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numba import types

from lowlevel.compiled import kernel
from lowlevel.pointers import octets_at

_HOLES = (*(1 << power for power in range(16, 10, -1)), *range(1024, 0, -16))  # bytes; the largest first
# Python's allocator gives out pieces of pools, each for one size (Objects/obmalloc.c, since Python 3.10). In bytes:
_POOL = 1 << 14
_HEAD = 48  # before its first piece, beginning with how many are in use
_SMALL = range(16, 513, 16)  # bytes: the sizes that pools are for
_MOST_HOLES = 1 << 20  # bytes of each size, in pools; should Python's allocator be another one, it ends there
_LARGE = 1 << 20  # bytes of anonymous memory, as those that pools come from; what is smaller is not worth a file
_ROOM = 1 << 36  # bytes, none of them in memory: realloc(3) lets a mapping grow, and behind its file is nothing
_SMAPS = Path("/proc/self/smaps")
_MAPPING = re.compile(
    r"^([0-9a-f]+)-([0-9a-f]+) (\S+) \S+ \S+ \S+ *(.*)(?:\n[A-Z].*)*?\nAnonymous: +(\d+) kB", re.MULTILINE
)
_PRIVATE_AND_THERE = mmap.MAP_PRIVATE | 0x10  # MAP_FIXED

_LIBC = ctypes.CDLL(None)
_LIBC.malloc.restype = _LIBC.sbrk.restype = ctypes.c_void_p
_take_small = ctypes.pythonapi.PyObject_Malloc
_take_small.restype = ctypes.c_void_p

_mmap: Any = types.ExternalFunction(
    "mmap", types.intp(types.intp, types.intp, types.int32, types.int32, types.int32, types.intp)
)
_madvise: Any = types.ExternalFunction("madvise", types.int32(types.intp, types.intp, types.int32))
_pwrite: Any = types.ExternalFunction("pwrite", types.intp(types.int32, types.intp, types.intp, types.intp))


class _Heap(ctypes.Structure):
    """Figures about the heap (mallinfo2(3)), in bytes: ``free`` in all, and ``top`` of it behind all that is in use."""

    _fields_ = (("others", ctypes.c_size_t * 8), ("free", ctypes.c_size_t), ("top", ctypes.c_size_t))


def forget_lookups() -> None:
    """Let Python's cache of the attributes of types hold no name.

    It is full of names that a child will never look up. Where Python counts who uses a name, a child would write to two
    strings for each that takes the place of another.
    """
    ctypes.pythonapi.PyType_ClearCache()


def fill_holes() -> None:
    """Leave no free memory between what is in use: a child would put its own there, each piece on a page to copy.

    What it asks for afterwards lies side by side, on pages of its own; the holes, about a megabyte, are lost.
    """
    for size in _SMALL:
        for _ in range(_MOST_HOLES // size):
            piece = _take_small(ctypes.c_size_t(size))
            if piece % _POOL == _HEAD and ctypes.c_uint.from_address(piece - _HEAD).value == 1:
                break  # the first one of a new pool: none was left in others
    try:
        figures = _LIBC.mallinfo2
    except AttributeError:  # not the C library of GNU, or one before 2.33
        return
    figures.restype = _Heap
    end = _LIBC.sbrk(0) - figures().top
    for size in _HOLES:
        while True:
            hole = ctypes.c_void_p(_LIBC.malloc(ctypes.c_size_t(size)))
            if hole.value is None or hole.value >= end:
                _LIBC.free(hole)
                break


def join_mappings() -> None:
    """Let constants of compiled code have the permissions of the code beside them, so that both are one mapping.

    LLVM makes two for each kernel, and a fork describes every mapping anew.
    """
    anonymous = [(ends, permissions) for *ends, permissions, name, _ in _mappings() if not name]
    of_code = {end for ends, permissions in anonymous if permissions == "r-xp" for end in ends}
    for (start, end), permissions in anonymous:
        if permissions == "r--p" and of_code.intersection((start, end)):
            _LIBC.mprotect(ctypes.c_void_p(start), ctypes.c_size_t(end - start), mmap.PROT_READ | mmap.PROT_EXEC)


def move_to_files() -> None:
    """Put what is in memory by now into files without names, and these, privately mapped, in its place.

    The addresses, what is there and who may write to it stay as they are. But a fork leaves pages of a file alone that
    nobody has written to: a child finds them when it needs them. Done for the heap, for Python's arenas, and for what
    the dynamic linker has written and sealed in libraries. Where there can be no such file all stays as it was, and
    where there is another thread, since it would write meanwhile; so would the handler of a signal.
    """
    if not hasattr(os, "memfd_create") or len(list(Path("/proc/self/task").iterdir())) > 1:
        return
    for start, end, protection in _worth_a_file():
        with contextlib.suppress(OSError):
            file = os.memfd_create("before the fork")
            try:
                os.ftruncate(file, end - start + _ROOM)
                _move(start, end - start, mmap.PAGESIZE, protection, file)
            finally:
                os.close(file)


def _worth_a_file() -> list[tuple[int, int, int]]:
    """Mappings, each its two ends and its protection."""
    found = []
    for start, end, permissions, name, changed in _mappings():
        if permissions == "rw-p" and (name == "[heap]" or (not name and end - start >= _LARGE)):
            found.append((start, end, mmap.PROT_READ | mmap.PROT_WRITE))
        elif permissions == "r--p" and name.startswith("/") and changed:
            found.append((start, end, mmap.PROT_READ))
    return found


def _mappings() -> list[tuple[int, int, str, str, int]]:
    """Of this process: ends, permissions, name, and how many kilobytes of each are in no file; none if unknown."""
    if not _SMAPS.exists():
        return []
    found = _MAPPING.findall(_SMAPS.read_text())
    return [(int(start, 16), int(end, 16), *words, int(kilobytes)) for start, end, *words, kilobytes in found]


@kernel("void(int64, int64, int64, int32, int32)")
def _move(start: int, size: int, page: int, protection: int, file: int) -> None:
    """Of one mapping. Compiled code writes nowhere but to the stack: what was written meanwhile would be lost."""
    if _madvise(start, size, 0) != 0:  # a part has gone since it was listed
        return
    for place in range(0, size, page):
        used = octets_at(start + place, page).view(np.int64).any()
        if used and _pwrite(file, start + place, page, place) != page:
            return
    _mmap(start, size, protection, _PRIVATE_AND_THERE, file, 0)
