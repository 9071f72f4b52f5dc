"""The kinds of problem: built-in ones, those of other installed packages, and the import of a user's own kind.

A package registers a kind by an entry point of the group ``supernode.problems``: a name, and where its class is. This
project registers the built-in kinds in the same way.
"""

import functools
import importlib
import importlib.util
import sys
from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from operator import attrgetter
from pathlib import Path
from types import ModuleType

from lowlevel import capabilities
from problems.errors import BadInput, did_you_mean
from problems.plain_values import is_file
from problems.problem import Problem

GROUP = "supernode.problems"
_OWN = "problems."  # modules of this project begin with this; importing one runs no user's code
_read: set[str] = set()  # the names of modules that were loaded from the folder of a problem file


@functools.cache
def _entries() -> dict[str, tuple[EntryPoint, ...]]:
    """Return all registered kinds, sorted by name. Several packages may register the same name.

    This reads a file of each installed package, a few milliseconds in all, and imports none of them.

    Raises:
        BadInput: if not even the built-in kinds are registered.
    """
    found: dict[str, tuple[EntryPoint, ...]] = {}
    for entry in sorted(entry_points(group=GROUP), key=attrgetter("name")):
        found[entry.name] = (*found.get(entry.name, ()), entry)
    if not any(map(_is_own, (entry for entries in found.values() for entry in entries))):
        raise BadInput(
            f"expected the built-in kinds among the entry points {GROUP!r}, found none: install this project again "
            "(pip install -e .)"
        )
    return found


def _is_own(entry: EntryPoint) -> bool:
    return entry.module.startswith(_OWN)


def registered() -> tuple[str, ...]:
    """Return the names of all registered kinds, sorted: the built-in ones and those of other installed packages."""
    return tuple(_entries())


def kinds() -> tuple[str, ...]:
    """Return the names of the built-in kinds, sorted."""
    return tuple(kind for kind in _entries() if is_built_in(kind))


def is_built_in(kind: str) -> bool:
    """Return whether ``kind`` is built in, so that importing it runs no user's code."""
    return ":" not in kind and any(map(_is_own, _entries().get(kind, ())))


def is_users_own(kind: str) -> bool:
    """Return whether importing ``kind`` runs a user's code; False for built-in kinds and for unknown names."""
    return ":" in kind or (kind in _entries() and not is_built_in(kind))


def find_built_in(kind: str) -> type[Problem]:
    """Return the class of a built-in kind; this never imports a user's module.

    Raises:
        BadInput: if there is no such built-in kind.
    """
    if not is_built_in(kind):
        raise BadInput(f"expected one of {', '.join(kinds())}, found {kind!r}" + did_you_mean(kind, kinds()))
    return find(kind)


def find_registered(kind: str) -> type[Problem]:
    """Return the class of a registered kind.

    Raises:
        BadInput: if there is no such kind, or it cannot be imported.
    """
    if kind not in _entries():
        raise BadInput(f"expected one of {', '.join(registered())}, found {kind!r}" + did_you_mean(kind, registered()))
    return find(kind)


def find(kind: str, folder: Path | None = None) -> type[Problem]:
    """Return the class of a kind; for a user's own kind, import its module.

    Args:
        kind: a registered kind, or ``"my_module:MyProblem"``.
        folder: where the module of ``"my_module:MyProblem"`` is looked up before ``sys.path``; None: on ``sys.path``
            only.

    Raises:
        BadInput: if there is no such kind, module or class, or several packages register the kind.
    """
    entry = None if ":" in kind else _entry_of(kind)  # a kind with a colon names its module itself
    try:
        if entry is not None:
            found = entry.load()
        else:
            module_name, _, class_name = kind.partition(":")
            found = getattr(_module(module_name, folder), class_name)
    except (Exception, SystemExit) as error:  # a user's module may raise anything, or call sys.exit
        raise BadInput(f"kind: cannot import {kind!r}: {type(error).__name__}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Problem)):
        raise BadInput(f"kind: expected a subclass of supernode.Problem, found {kind!r}, which is {found!r}")
    return found


def _entry_of(kind: str) -> EntryPoint:
    """Return where the class of a registered kind is.

    Raises:
        BadInput: if no package registers the kind, or several do, with different classes.
    """
    entries = _entries().get(kind, ())
    if not entries:
        raise BadInput(
            f'kind: expected one of {", ".join(registered())} or "module:Class", found {kind!r}'
            + did_you_mean(kind, registered())
        )
    if len({entry.value for entry in entries}) > 1:
        claims = " and ".join(f"{entry.dist.name if entry.dist else '?'} ({entry.value})" for entry in entries)
        raise BadInput(f"kind: expected one package that registers {kind!r}, found {claims}: uninstall all but one")
    return entries[0]


def _module(name: str, folder: Path | None) -> ModuleType:
    """Import a module; one that lies in ``folder`` is loaded again even if it is loaded already.

    It may have been edited since, or the module of that name may have come from another folder.

    Raises:
        ImportError: if another module of that name is in use that did not come from the folder of a problem file.
    """
    if folder is None:
        return importlib.import_module(name)
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))  # so that a user's module can import others beside it
    beside = folder / f"{name}.py"
    if not is_file(beside):
        return importlib.import_module(name)
    old = sys.modules.get(name)
    # Replacing a module that this process uses itself, such as one of the standard library, would break it.
    if (
        old is not None
        and name not in _read
        and Path(str(getattr(old, "__file__", None))).resolve() != beside.resolve()
    ):
        raise ImportError(f"there is another module {name!r} already; rename {beside}")
    spec = importlib.util.spec_from_file_location(name, beside)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: its classes look up their annotations there
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]  # as the import statement does: a half-initialised module must not be found later
        raise
    _read.add(name)
    return module


def imported_kinds() -> tuple[str, ...]:
    """Return the built-in kinds whose packages this process has imported: those that the loaded problems may use."""
    return tuple(kind for kind in kinds() if any(entry.module in sys.modules for entry in _entries()[kind]))


def kernels(wanted: Collection[str] | None = None) -> tuple[str, ...]:
    """Return the names of the modules with compiled kernels; a module that others import comes before them.

    Args:
        wanted: the built-in kinds whose kernels are meant, besides those that all kinds share; None for all kinds.
    """
    shared = ("bit_kernels", "real_kernels", "selection", "replacement", "sequence_kernels", "permutation_kernels")
    names = [f"genetics.{name}" for name in shared]
    names += [*_in_packages("kernels", wanted), *_in_packages("coding_kernels", wanted)]
    if capabilities().numba_calls:
        names += ["genetics.calls_by_address", *_in_packages("costly_kernels", wanted)]
    return tuple(names)


def _in_packages(module: str, wanted: Collection[str] | None) -> list[str]:
    """Return the full names of the modules called ``module`` in the packages of the wanted kinds; import nothing."""
    packages = [
        entry.module
        for kind, entries in _entries().items()
        if wanted is None or kind in wanted
        for entry in entries
        if _is_own(entry)
    ]
    root = Path(__file__).parent
    return [
        f"{package}.{module}" for package in packages if (root / package.removeprefix(_OWN) / f"{module}.py").is_file()
    ]


def warm_up(wanted: Collection[str] | None = None) -> None:
    """Import the wanted kinds with their kernels and codings, so that processes forked from this one share them."""
    for name in (*kernels(wanted), *_in_packages("coding", wanted)):
        importlib.import_module(name)
