"""The built-in kinds of problem, and the import of a user's own kind."""

import importlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

from lowlevel import capabilities
from problems.errors import BadInput, did_you_mean
from problems.problem import Problem

_BUILT_IN = {
    "arm-ik": "problems.arm_ik:ArmIk",
    "arm-path": "problems.arm_path:ArmPath",
    "coordination": "problems.coordination:Coordination",
    "function": "problems.function:Function",
    "min-time": "problems.min_time:MinTime",
    "mobile-robot": "problems.mobile_robot:MobileRobot",
    "sphere-path": "problems.sphere_path:SpherePath",
    "terrain": "problems.terrain:Terrain",
}
_read: set[str] = set()  # the names of modules that were loaded from the folder of a problem file


def kinds() -> tuple[str, ...]:
    """Return the names of the built-in kinds, sorted."""
    return tuple(_BUILT_IN)


def is_built_in(kind: str) -> bool:
    """Return whether ``kind`` is built in, so that importing it runs no user's code."""
    return kind in _BUILT_IN


def find_built_in(kind: str) -> type[Problem]:
    """Return the class of a built-in kind; this never imports a user's module.

    Raises:
        BadInput: if there is no such built-in kind.
    """
    if not is_built_in(kind):
        raise BadInput(f"expected one of {', '.join(_BUILT_IN)}, found {kind!r}" + did_you_mean(kind, _BUILT_IN))
    return find(kind)


def find(kind: str, folder: Path | None = None) -> type[Problem]:
    """Return the class of a kind; for a user's own kind, import its module.

    Args:
        kind: a built-in kind, or ``"my_module:MyProblem"``.
        folder: where a user's module is looked up before ``sys.path``; None: on ``sys.path`` only.

    Raises:
        BadInput: if there is no such kind, module or class.
    """
    if kind not in _BUILT_IN and ":" not in kind:  # a user's own kind always has a colon
        raise BadInput(
            f'kind: expected one of {", ".join(_BUILT_IN)} or "module:Class", found {kind!r}'
            + did_you_mean(kind, _BUILT_IN)
        )
    module_name, _, class_name = _BUILT_IN.get(kind, kind).partition(":")
    try:
        found = getattr(_module(module_name, None if is_built_in(kind) else folder), class_name)
    except (Exception, SystemExit) as error:  # a user's module may raise anything, or call sys.exit
        raise BadInput(f"kind: cannot import {kind!r}: {type(error).__name__}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Problem)):
        raise BadInput(f"kind: expected a subclass of supernode.Problem, found {kind!r}, which is {found!r}")
    return found


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
    if not beside.is_file():
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


def kernels() -> tuple[str, ...]:
    """Return the names of the modules with compiled kernels; a module that others import comes before them."""
    shared = ("bit_kernels", "real_kernels", "selection", "replacement", "sequence_kernels", "permutation_kernels")
    names = [*(f"genetics.{name}" for name in shared), *_in_packages("kernels"), *_in_packages("coding_kernels")]
    if capabilities().numba_calls:
        names += ["genetics.calls_by_address", *_in_packages("costly_kernels")]
    return tuple(names)


def _in_packages(module: str) -> list[str]:
    """Return the full names of the modules called ``module`` in the built-in packages, which this imports."""
    names = [f"{target.partition(':')[0]}.{module}" for target in _BUILT_IN.values()]
    return [name for name in names if importlib.util.find_spec(name)]


def warm_up() -> None:
    """Import every built-in kind with all kernels and codings, so that processes forked from this one share them."""
    for name in (*kernels(), *_in_packages("coding")):
        importlib.import_module(name)
