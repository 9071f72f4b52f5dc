"""The cache of compiled kernels: one folder for each module, named by a digest of the module and all that it imports.

Numba notices a change of a kernel's own file, but not of the subroutines in other files that it compiles into the
kernel. A stale kernel would silently break bit-identical replay. A folder that is named by a digest of the module and
all its imports cannot be stale, and an edit recompiles only what depends on it. The digest is of contents, not of
modification times, so two checkouts of the same sources share their kernels.

Rejected: one folder named by a digest of all sources, since an edit of any file would recompile everything.
"""

from __future__ import annotations

import functools
import hashlib
import os
import re
import shutil
from pathlib import Path
from typing import Any

_PROJECT = Path(__file__).resolve().parent.parent
_KEPT = 16  # folders of one module; those unused for the longest time are deleted first
_MODULE_IMPORT = re.compile(r"^import +([\w.]+)", re.MULTILINE)
_NAMES_IMPORT = re.compile(r"^from +([\w.]+) +import +(?:\(([^)]*)\)|(.*))", re.MULTILINE)
_COMMENT = re.compile(r"#.*")

_own_files: set[str] = set()


def base_folder() -> Path:
    """Return the folder of the whole cache: ``NUMBA_CACHE_DIR`` if it is set, else one in the user's cache folder."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "supernode" / "kernels"


def keep_kernels_of(file: str) -> None:
    """Put the kernels of a source file under the care of this cache. Those of other libraries stay numba's business."""
    _own_files.add(file)


class ModuleLocator:
    """Tells numba where the kernels of one source file are cached: a class for ``NUMBA_CACHE_LOCATOR_CLASSES``.

    Numba calls the methods; their names are those of numba's `_CacheLocator`.
    """

    def __init__(self, folder: Path, line: int) -> None:
        self._folder = folder
        self._line = line

    @classmethod
    def from_function(cls, function: Any, file: str) -> ModuleLocator | None:
        """Return the locator for a function of ``file``; None if the file is another library's, or on an error."""
        if file not in _own_files:
            return None
        try:
            return cls(folder_of(file), function.__code__.co_firstlineno)
        except OSError:
            return None  # the folder cannot be made: numba falls back to its own locators

    def get_cache_path(self) -> str:
        """Return the folder of the file's kernels."""
        return str(self._folder)

    def ensure_cache_path(self) -> None:
        """Do nothing: `from_function` has made the folder."""

    def get_source_stamp(self) -> str:
        """Return the folder's name. It contains the digest, so the stamp differs if any source differs."""
        return self._folder.name

    def get_disambiguator(self) -> str:
        """Return the first line of the function, since a file may have several functions of one name."""
        return str(self._line)


@functools.cache
def folder_of(file: str) -> Path:
    """Return the folder of a source file's kernels. Make it if need be, deleting old ones, and mark it as used.

    Raises:
        OSError: if the folder cannot be made.
    """
    path = Path(file).resolve()
    module = ".".join(path.relative_to(_PROJECT).with_suffix("").parts) if path.is_relative_to(_PROJECT) else path.stem
    folder = base_folder() / f"{module}-{digest_of(path)}"
    if not folder.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        _forget_oldest(folder.parent, module)
    if os.access(folder, os.W_OK):  # a cache that was installed read-only needs no mark
        os.utime(folder)
    return folder


def _forget_oldest(base: Path, module: str) -> None:
    """Delete all but the most recently used folders of a module."""

    def last_use(folder: Path) -> float:
        try:
            return folder.stat().st_mtime
        except OSError:  # another process deleted it
            return 0.0

    for old in sorted(base.glob(f"{module}-*"), key=last_use, reverse=True)[_KEPT:]:
        shutil.rmtree(old, ignore_errors=True)


def digest_of(path: Path) -> str:
    """Return a digest of the contents of a source file and of all files that it imports, directly or indirectly."""
    # Sorted by content, not by path, so that it does not matter where a checkout is.
    contents = sorted(_digest_of_one(each) for each in sources_of(path))
    return hashlib.sha256(b"".join(contents)).hexdigest()[:16]


@functools.cache
def _digest_of_one(path: Path) -> bytes:
    return hashlib.sha256(path.read_bytes()).digest()


def sources_of(path: Path) -> set[Path]:
    """Return a source file and all files that it imports, directly or indirectly.

    Only files of this project, or in the folder of the importing file (a user's own modules), are followed.
    """
    found = {path}
    waiting = [path]
    while waiting:
        new = set(_imports_of(waiting.pop())) - found
        found |= new
        waiting += new
    return found


@functools.cache
def _imports_of(path: Path) -> tuple[Path, ...]:
    """Return the files that a source file imports at its top level.

    Imports within functions, and those for type checkers only, are indented and do not match. No kernel can use them:
    numba resolves a kernel's names in the globals of its module.
    """
    text = path.read_text()
    names = set(_MODULE_IMPORT.findall(text))
    for module, in_brackets, in_line in _NAMES_IMPORT.findall(text):
        parts = _COMMENT.sub("", in_brackets or in_line).split(",")
        names |= {f"{module}.{part.split()[0]}" for part in parts if part.strip()}
    roots = {_PROJECT, path.parent}
    files = {file for name in names for root in roots if (file := _file_of(name, root)) is not None}
    return tuple(files)


def _file_of(name: str, root: Path) -> Path | None:
    """Return the file of a dotted name below ``root``: the module itself, or the one that defines the name; or None."""
    parts = name.split(".")
    for length in (len(parts), len(parts) - 1):
        stem = root.joinpath(*parts[:length])
        for file in (stem.with_suffix(".py"), stem / "__init__.py"):
            if length > 0 and file.is_file():
                return file
    return None
