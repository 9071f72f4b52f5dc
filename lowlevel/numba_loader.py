"""Load cached kernels without the work and the memory that only compilation needs.

A cluster starts with one process, the zygote, which finds all kernels in the cache and from which a thousand others are
forked. Each fork copies the description (the page tables) of all memory that the zygote has, so less memory means
faster forks. Numba has no settings for this. This module therefore replaces two of numba's internals, which do eagerly
what here is done later, and only if compilation needs it:

- the intermediate code of a cached kernel is parsed (`Library`);
- SciPy's linear algebra is imported (`_leave_blas_for_later`).

Both depend on numba's version; `tests/lowlevel/test_numba_loader.py` shows whether they still work.
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
"""Elf64_Sym (elf(5)): offset of the name, type, visibility, section, value, size."""
_DEFINED_ELSEWHERE = 0  # SHN_UNDEF


class Library(JITCodeLibrary):
    """A cached kernel whose intermediate code is parsed only when the kernel is compiled into another one.

    Parsing it for all kernels takes a third of the time of loading them, and as much memory as everything else.
    """

    _intermediate_code: bytes | None = None

    @classmethod
    def _unserialize(cls, codegen: Any, state: Any) -> Any:
        name, kind, data = state
        # What numba's own method does, but for parsing the intermediate code.
        if kind != "object":
            return super()._unserialize(codegen, state)  # type: ignore[no-untyped-call]
        machine_code, intermediate_code = data
        library: Any = codegen.create_library(name)
        library.enable_object_caching()
        library._set_compiled_object(machine_code)
        library._finalize_final_module()
        # Numba takes the names from the parsed intermediate code; the machine code has them too.
        codegen._engine._defined_symbols |= _symbols(machine_code)
        library._intermediate_code = intermediate_code
        return library

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._intermediate_code is not None:
            self._shared_module = llvm.parse_bitcode(self._intermediate_code)
            self._intermediate_code = None
        return super()._get_module_for_linking()  # type: ignore[no-untyped-call]


def _symbols(machine_code: bytes) -> set[str]:
    """Return the names of the symbols that an object file (ELF) defines."""
    sections = llvm.ObjectFileRef.from_data(machine_code).sections()
    tables = {each.name(): each.data() for each in sections if each.name() in (b".strtab", b".symtab")}
    names = tables[b".strtab"]
    found = ((at, section) for at, _, _, section, _, _ in _SYMBOL.iter_unpack(tables[b".symtab"]))
    return {names[at : names.index(0, at)].decode() for at, section in found if section != _DEFINED_ELSEWHERE}


def load_quickly() -> None:
    """Replace numba's loading by the quick one. Call it before the first kernel is loaded."""
    JITCPUCodegen._library_class = Library
    _leave_blas_for_later()


def _leave_blas_for_later() -> None:
    """Keep numba from importing SciPy's linear algebra, 130 modules, only to find out whether it is installed.

    Afterwards numba looks for it when it compiles code that might use it. Compiled code that uses it imports it when it
    first runs.
    """
    if _BLAS in sys.modules or _ARRAYS in sys.modules:
        return  # too late, and no harm: the modules are in memory already
    sys.modules[_BLAS] = None  # type: ignore[assignment] # makes the import fail
    try:
        arrays: Any = importlib.import_module(_ARRAYS)
    finally:
        del sys.modules[_BLAS]
    # By way of a function's globals, since in some versions of numba this module only redirects to another one.
    own: dict[str, Any] = arrays._get_inner_prod.__globals__
    own["_HAVE_BLAS"] = _Asked(own["_check_blas"])


class _Asked:
    """A flag that calls a function each time that its truth is tested, instead of having a fixed value."""

    def __init__(self, ask: Callable[[], bool]) -> None:
        self._ask = ask

    def __bool__(self) -> bool:
        return self._ask()
