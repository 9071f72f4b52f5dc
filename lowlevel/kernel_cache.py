"""Where compiled kernels are kept: in folders named by the contents of what each kernel's module imports.

Numba notices a change of a kernel's own file, but not of the subroutines in other files that it compiles into the
kernel: a stale copy would silently break bit-identical replay. A folder for each module, named by a digest of that
module and of all it imports, cannot be stale, and an edit recompiles only what depends on it. Contents count, not
times of change, so two checkouts of the same sources share what they compiled.

Rejected: one folder for a digest of all sources, as an edit of any file then recompiled everything.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
from pathlib import Path
from typing import Any

_HOUSE = Path(__file__).resolve().parent.parent
_KEPT = 16  # folders of one module; the ones longest unused go first
_MODULE_IMPORT = re.compile(r"^import +([\w.]+)", re.MULTILINE)
_NAMES_IMPORT = re.compile(r"^from +([\w.]+) +import +(?:\(([^)]*)\)|(.*))", re.MULTILINE)
_COMMENT = re.compile(r"#.*")

_own_files: set[str] = set()


def base_folder() -> Path:
    """The folder of all kept kernels: ``NUMBA_CACHE_DIR`` if it is set, else in the user's cache folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "supernode" / "kernels"


def keep_kernels_of(file: str) -> None:
    """Let the kernels of this source file be kept as this module says; those of other libraries are numba's own."""
    _own_files.add(file)


class ModuleLocator:
    """Tells numba where the kernels of one source file are (``NUMBA_CACHE_LOCATOR_CLASSES``)."""

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Any, file: str) -> ModuleLocator | None:
        """The locator for a function of ``file``; None if that is another library's or its folder cannot be written."""
        if file not in _own_files:
            return None
        try:
            return cls(_folder_of(file), function.__code__.co_firstlineno)
        except OSError:
            return None  # numba falls back to its own choice

    def get_cache_path(self) -> str:
        """The folder."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Nothing to do: `from_function` made the folder."""

    def get_source_stamp(self) -> str:
        """The folder's name, which says all that a stamp could."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """The line of the function, as several of one name may be in a file."""
        return str(self._line)


@functools.cache
def _folder_of(file: str) -> Path:
    """The folder of a source file's kernels; it is made, marked as used, and the oldest ones of the module go.

    Raises:
        OSError: if it cannot be made.
    """
    path = Path(file).resolve()
    module = ".".join(path.relative_to(_HOUSE).with_suffix("").parts) if path.is_relative_to(_HOUSE) else path.stem
    folder = base_folder() / f"{module}-{digest_of(path)}"
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        _forget_oldest(folder.parent, module)
    if os.access(folder, os.W_OK):
        os.utime(folder)
    return folder


def _forget_oldest(base: Path, module: str) -> None:
    """Delete all but the latest used folders of a module."""

    def last_use(folder: Path) -> float:
        try:
            return folder.stat().st_mtime
        except OSError:  # another process deleted it
            return 0.0

    for old in sorted(base.glob(f"{module}-*"), key=last_use, reverse=True)[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)


def digest_of(path: Path) -> str:
    """A digest of a source file's contents and of all files of this project, or beside it, that it imports."""
    found = {path}
    waiting = [path]
    while waiting:
        new = set(_imports_of(waiting.pop())) - found
        found |= new
        waiting += new
    contents = sorted(hashlib.sha256(each.read_bytes()).digest() for each in found)
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


@functools.cache
def _imports_of(path: Path) -> tuple[Path, ...]:
    """The files that a source file imports when it is itself imported.

    Imports within functions and for type checkers only are indented, and do not count: no kernel can use them.
    """
    text = path.read_text()
    names = set(_MODULE_IMPORT.findall(text))
    for module, in_brackets, in_line in _NAMES_IMPORT.findall(text):
        parts = _COMMENT.sub("", in_brackets or in_line).split(",")
        names |= {f"{module}.{part.split()[0]}" for part in parts if part.strip()}
    roots = {_HOUSE, path.parent}
    files = {file for name in names for root in roots if (file := _file_of(name, root)) is not None}
    return tuple(files)


def _file_of(name: str, root: Path) -> Path | None:
    """The file of a module below ``root``, or of the one that a name is imported from; None if there is none."""
    parts = name.split(".")
    for length in (len(parts), len(parts) - 1):
        stem = root.joinpath(*parts[:length])
        for file in (stem.with_suffix(".py"), stem / "__init__.py"):
            if length > 0 and file.is_file():
                return file
    return None
