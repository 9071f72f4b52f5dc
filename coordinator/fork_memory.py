"""What a process does about its memory before it forks, so that its children have little to copy.

A child copies each page that it writes to, and a fork an entry for each page of anonymous memory: most of what a
thousand nodes cost at their start.
"""

import ctypes
import mmap
from pathlib import Path

_HOLES = (*(1 << power for power in range(16, 10, -1)), *range(1024, 0, -16))  # bytes; the largest first
_LIBC = ctypes.CDLL(None)
_LIBC.malloc.restype = _LIBC.sbrk.restype = ctypes.c_void_p


class _Heap(ctypes.Structure):
    """Figures about the heap (mallinfo2(3)), in bytes: ``free`` in all, and ``top`` of it behind all that is in use."""

    _fields_ = (("others", ctypes.c_size_t * 8), ("free", ctypes.c_size_t), ("top", ctypes.c_size_t))


def fill_holes() -> None:
    """Leave no free memory between what is in use: a child would put its own there, each piece on a page to copy.

    What it asks for afterwards lies side by side, on pages of its own; the holes, some hundred kilobytes, are lost.
    """
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
    mappings = [line.split(maxsplit=5) for line in Path("/proc/self/maps").read_text().splitlines()]
    # The last word of a line is the inode, 0, where no file and no name follows.
    anonymous = [(addresses.split("-"), permissions) for addresses, permissions, *_, last in mappings if last == "0"]
    of_code = {each for addresses, permissions in anonymous if permissions == "r-xp" for each in addresses}
    for addresses, permissions in anonymous:
        if permissions == "r--p" and of_code.intersection(addresses):
            start, end = (int(address, 16) for address in addresses)
            _LIBC.mprotect(ctypes.c_void_p(start), ctypes.c_size_t(end - start), mmap.PROT_READ | mmap.PROT_EXEC)
