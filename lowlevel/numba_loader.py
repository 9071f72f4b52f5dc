"""How a process that finds all kernels in the cache is spared what only compiling needs.

A cluster starts with such a process, and a thousand others are forked from it: what it has in memory is described anew
for each of them. Numba has no settings for this, so here are the two places of its own where it is kept from being
early. Both do later, and only if it is asked for, what numba would have done at once.
"""

import importlib
import struct
import sys
from collections.abc import Callable
from typing import Any

from llvmlite import binding as llvm
from numba.core.codegen import JITCodeLibrary, JITCPUCodegen

_BLAS = "scipy.linalg.cython_blas"
_ARRAYS = "numba.np.arraymath"
_SYMBOL = struct.Struct("=IBBHQQ")
"""Elf64_Sym (elf(5)): where its name begins, type, visibility, section, value, size."""
_DEFINED_ELSEWHERE = 0  # SHN_UNDEF


class Library(JITCodeLibrary):
    """A kernel whose intermediate code is read only when it is compiled into another.

    To read that of all kernels takes a third of the time in which they are loaded, and as much memory as all else.
    """

    _intermediate_code: bytes | None = None

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        if kind != "object":
            return super()._unserialize(codegen, state)  # type: ignore[no-untyped-call]
        machine_code, intermediate_code = data
        library: Any = codegen.create_library(name)
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        codegen._engine._defined_symbols |= _symbols(machine_code)  # which numba asks the intermediate code for
        library._intermediate_code = intermediate_code
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._intermediate_code is not None:
            self._shared_module = llvm.parse_bitcode(self._intermediate_code)
            self._intermediate_code = None
        return super()._get_module_for_linking()  # type: ignore[no-untyped-call]


def _symbols(machine_code: bytes) -> set[str]:
    """What an object file defines."""
    sections = llvm.ObjectFileRef.from_data(machine_code).sections()
    tables = {each.name(): each.data() for each in sections if each.name() in (b".strtab", b".symtab")}
    names = tables[b".strtab"]
    found = ((at, section) for at, _, _, section, _, _ in _SYMBOL.iter_unpack(tables[b".symtab"]))
    return {names[at : names.index(0, at)].decode() for at, section in found if section != _DEFINED_ELSEWHERE}


def load_quickly() -> None:
    """Take numba's two shortcuts; must come before the first kernel is loaded."""
    JITCPUCodegen._library_class = Library
    _leave_blas_for_later()


def _leave_blas_for_later() -> None:
    """Numba imports all of SciPy's linear algebra, 130 modules, only to see whether it is there.

    That it looks for when it compiles what might use it. Compiled code that does use it imports it when it first runs.
    """
    if _BLAS in sys.modules or _ARRAYS in sys.modules:
        return
    sys.modules[_BLAS] = None  # type: ignore[assignment] # importing it fails
    try:
        arrays: Any = importlib.import_module(_ARRAYS)
    finally:
        del sys.modules[_BLAS]
    own: dict[str, Any] = arrays._get_inner_prod.__globals__  # the module's, which may have got another name
    own["_HAVE_BLAS"] = _Asked(own["_check_blas"])


class _Asked:
    """What a function says, each time that it matters."""

    def __init__(self, ask: Callable[[], bool]) -> None:
        self._ask = ask

    def __bool__(self) -> bool:
        return self._ask()
