"""Arrange the memory of a process before it forks, so that forks are cheap and children copy few pages.

A fork copies a page-table entry for each page of anonymous memory, and a child copies each page that it writes to.
These two are most of the cost of starting a thousand nodes, above all on a virtual machine whose host must first find
memory. For what this gains see docs/cluster.md. Where the system lacks something that a step needs, nothing changes.
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

# Sizes of the C heap's holes in bytes, the largest first, so that a large hole is not cut up by small requests.
_HOLES = (*(1 << power for power in range(16, 10, -1)), *range(1024, 0, -16))
# Python's allocator divides memory into pools, each with pieces of one size (Objects/obmalloc.c, since Python 3.10).
_POOL = 1 << 14  # bytes
_HEAD = 48  # bytes of a pool before its first piece; they begin with the number of pieces in use
_SMALL = range(16, 513, 16)  # bytes: the piece sizes of pools
_MOST_HOLES = 1 << 20  # bytes of each size; the loop ends there if Python's allocator works in another way
_LARGE = 1 << 20  # bytes: the size of the areas that pools come from; smaller mappings are not worth a file
_ROOM = 1 << 36  # bytes of file behind a mapping, for realloc(3) to grow into; they take no memory until written
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
    """The struct of mallinfo2(3), in bytes: ``free`` in total, and ``top``, the part of it behind everything in use."""

    _fields_ = (("others", ctypes.c_size_t * 8), ("free", ctypes.c_size_t), ("top", ctypes.c_size_t))


def forget_lookups() -> None:
    """Empty Python's cache of type attributes.

    The cache is full of names that a child will never look up. It holds references to these strings, so each entry that
    a child replaces makes it write to two reference counts, perhaps on two pages of their own.
    """
    ctypes.pythonapi.PyType_ClearCache()


def fill_holes() -> None:
    """Allocate, and give up, all free memory between what is in use.

    A child would place its objects in these holes, scattered over pages that it would have to copy. Without holes they
    lie side by side on new pages. About a megabyte is lost.
    """
    for size in _SMALL:
        for _ in range(_MOST_HOLES // size):
            piece = _take_small(ctypes.c_size_t(size))
            if piece % _POOL == _HEAD and ctypes.c_uint.from_address(piece - _HEAD).value == 1:
                break  # the first piece of a new pool, so the pools in use are full
    try:
        figures = _LIBC.mallinfo2
    except AttributeError:  # not the GNU C library, or a version before 2.33
        return
    figures.restype = _Heap
    end = _LIBC.sbrk(0) - figures().top
    for size in _HOLES:
        while True:  # until an allocation comes from behind everything in use: then no hole of that size is left
            hole = ctypes.c_void_p(_LIBC.malloc(ctypes.c_size_t(size)))
            if hole.value is None or hole.value >= end:
                _LIBC.free(hole)
                break


def join_mappings() -> None:
    """Give the constants of compiled code the permissions of the code beside them, so that both are one mapping.

    LLVM makes two mappings for each kernel, and a fork copies the description of every mapping.
    """
    anonymous = [(ends, permissions) for *ends, permissions, name, _ in _mappings() if not name]
    of_code = {end for ends, permissions in anonymous if permissions == "r-xp" for end in ends}
    for (start, end), permissions in anonymous:
        if permissions == "r--p" and of_code.intersection((start, end)):
            _LIBC.mprotect(ctypes.c_void_p(start), ctypes.c_size_t(end - start), mmap.PROT_READ | mmap.PROT_EXEC)


def move_to_files() -> None:
    """Copy the memory's contents into files without names, and map these privately in its place.

    Addresses, contents and permissions stay the same. But a fork skips unwritten pages of a file mapping, which a child
    maps when it first needs them. This covers the heap, Python's arenas, and what the dynamic linker has written and
    sealed in libraries. Nothing happens where such files cannot be made, or where there is another thread: what it
    wrote meanwhile would be lost. The same would happen to what a signal handler writes.
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
    """Return the mappings to move, each with its start, its end and its protection."""
    found = []
    for start, end, permissions, name, changed in _mappings():
        if permissions == "rw-p" and (name == "[heap]" or (not name and end - start >= _LARGE)):
            found.append((start, end, mmap.PROT_READ | mmap.PROT_WRITE))
        elif permissions == "r--p" and name.startswith("/") and changed:
            found.append((start, end, mmap.PROT_READ))
    return found


def _mappings() -> list[tuple[int, int, str, str, int]]:
    """Return this process's mappings: start, end, permissions, name, and kilobytes that are in no file.

    The list is empty where /proc does not tell.
    """
    if not _SMAPS.exists():
        return []
    found = _MAPPING.findall(_SMAPS.read_text())
    return [(int(start, 16), int(end, 16), *words, int(kilobytes)) for start, end, *words, kilobytes in found]


@kernel("void(int64, int64, int64, int32, int32)")
def _move(start: int, size: int, page: int, protection: int, file: int) -> None:
    """Copy one mapping to a file and map that in its place; on any failure leave the mapping as it is.

    Compiled code, since it writes to the stack only: Python would write to the heap between the copy and the mapping.
    """
    if _madvise(start, size, 0) != 0:  # a part of it was unmapped since it was listed
        return
    for place in range(0, size, page):
        used = octets_at(start + place, page).view(np.int64).any()
        if used and _pwrite(file, start + place, page, place) != page:
            return
    _mmap(start, size, protection, _PRIVATE_AND_THERE, file, 0)
