"""Compile the kernels that the cache lacks, on all cores, before a cluster is started.

    python -m coordinator.launch.compilation                  # of all kinds
    python -m coordinator.launch.compilation mobile-robot     # only what jobs of these kinds need
    python -m coordinator.launch.compilation --all            # also what only oracles need

Importing a module compiles its kernels, so a zygote would compile them too, but one after another, while its caller
waits. Here several processes compile, each as soon as the modules that it imports are compiled: then no kernel is
compiled twice.

A module that is compiled gets a mark in its folder of the cache. `compile_missing` looks for the marks, which takes
some milliseconds, and starts the compilation only if one is missing.
"""

import functools
import importlib
import os
import re
import subprocess
import sys
import traceback
from collections.abc import Callable, Collection, Iterable
from importlib.metadata import version
from pathlib import Path

from coordinator.errors import ClusterFailed
from coordinator.threads import ONE_THREAD
from lowlevel import capabilities, kernel_cache, linux
from problems import registry

_ROOT = Path(__file__).resolve().parents[2]
_COMPILES = re.compile(r"^@(kernel|c_function)\(", re.MULTILINE)


def compile_missing(kinds: Collection[str] | None = None, say: Callable[[str], None] = lambda _: None) -> None:
    """Compile the kernels that the cache lacks, in processes of their own; return at once if it has them all.

    Args:
        kinds: the built-in kinds whose kernels are needed; None for all.
        say: called with a line for people if there is something to compile.

    Raises:
        ClusterFailed: if a kernel cannot be compiled.
    """
    if not _missing(_modules(kinds)):
        return
    say(f"compiling the kernels of {'all kinds' if kinds is None else ', '.join(sorted(kinds)) or 'nodes'}, once")
    command = [sys.executable, "-P", "-m", __name__, *([] if kinds is None else ["--", *kinds])]
    if subprocess.run(command, env=os.environ | ONE_THREAD, check=False).returncode:
        raise ClusterFailed("the kernels could not be compiled; see the error above")


def _modules(kinds: Collection[str] | None) -> dict[str, Path]:
    """Return the modules with kernels that nodes and jobs of the kinds import, and their files."""
    names = ["node.fast_path"] if capabilities().c_api else ["node.driver"]
    files: set[Path] = set()
    for name in (*names, *registry.kernels(kinds)):
        files |= kernel_cache.sources_of(_ROOT / f"{name.replace('.', '/')}.py")
    return {_name_of(file): file for file in sorted(files) if _has_kernels(file)}


def _all_modules() -> dict[str, Path]:
    """Return all modules of this project that have kernels, also those that nodes do not import, such as oracles."""
    packages = {f"{package.partition('.')[0]}" for package in _modules(None)}
    files = (file for package in packages for file in sorted((_ROOT / package).rglob("*.py")))
    return {_name_of(file): file for file in files if _has_kernels(file)}


def _name_of(file: Path) -> str:
    return ".".join(file.relative_to(_ROOT).with_suffix("").parts)


@functools.cache
def _has_kernels(file: Path) -> bool:
    return _COMPILES.search(file.read_text(encoding="utf-8")) is not None


def _missing(modules: dict[str, Path]) -> dict[str, Path]:
    """Return the modules without a mark, except those whose folder cannot be written."""
    return {name: file for name, file in modules.items() if _lacks_mark(file)}


def _lacks_mark(file: Path) -> bool:
    try:
        mark = _mark_of(file)
    except OSError:  # the folder cannot be made: each process compiles for itself
        return False
    return not mark.exists() and os.access(mark.parent, os.W_OK)


def _mark_of(file: Path) -> Path:
    """Return the file that says that all kernels of a module are in the cache.

    Numba compiles again for another version of itself, of Python, or for another processor. Of these only the processor
    is not in the name: kernels that are missing in spite of a mark are compiled by the process that needs them.
    """
    processor = os.environ.get("NUMBA_CPU_NAME", "host")
    return kernel_cache.folder_of(str(file)) / f"compiled-{sys.implementation.cache_tag}-{version('numba')}-{processor}"


def compile_modules(modules: dict[str, Path]) -> list[str]:
    """Compile the kernels of the modules on all cores; return the names of those that could not be compiled."""
    _import_compiler()
    groups = _groups_of(modules)
    needs = {name: _needs_of(name, groups, modules) for name in groups}
    # First the one with the most source text in it and in what waits for it: else the longest chain begins last.
    sizes = {name: sum(modules[each].stat().st_size for each in groups[name]) for name in groups}
    behind = {name: sum(sizes[each] for each in groups if each == name or name in needs[each]) for name in groups}
    waiting = sorted(groups, key=lambda name: -behind[name])
    running: dict[int, str] = {}
    done: set[str] = set()
    failed: list[str] = []
    while waiting or running:
        ready = [name for name in waiting if needs[name] <= done]
        while ready and len(running) < len(os.sched_getaffinity(0)):
            name = ready.pop(0)
            waiting.remove(name)
            running[_fork({each: modules[each] for each in groups[name]})] = name
        process, status = os.wait()
        name = running.pop(process)
        done.add(name)  # if it has failed too: what depends on it reports the same error
        if status:
            failed.append(name)
    return failed


def _groups_of(modules: dict[str, Path]) -> dict[str, list[str]]:
    """Return the modules of each process, by a name for it.

    A process compiles a subroutine once for all kernels that use it. So the modules of a kind of problem share one,
    and those of the node, each of which is compiled into the next, share one too. Those of `genetics` and `wire` use
    little of each other, and the node waits for them.
    """
    groups: dict[str, list[str]] = {}
    for name in modules:
        package, _, rest = name.partition(".")
        group = {"node": package, "problems": f"{package}.{rest.partition('.')[0]}"}.get(package, name)
        groups.setdefault(group, []).append(name)
    return groups


def _needs_of(group: str, groups: dict[str, list[str]], modules: dict[str, Path]) -> set[str]:
    """Return the other groups that have a module which one of this group imports."""
    sources = set().union(*(kernel_cache.sources_of(modules[name]) for name in groups[group]))
    return {other for other in groups if other != group and any(modules[name] in sources for name in groups[other])}


def _import_compiler() -> None:
    """Import all of numba that compiling needs, so that each forked process has it already."""
    from lowlevel.compiled import kernel

    kernel("float64(float64[::1])")(_anything)


def _anything(values: Iterable[float]) -> float:
    total = 0.0
    for value in values:
        total += value
    return total


def _fork(modules: dict[str, Path]) -> int:
    """Compile the modules in a process of its own and put their marks; return the process id."""
    parent = os.getpid()
    process = os.fork()
    if process:
        return process
    try:
        linux.end_with_parent(parent)
        for name, file in modules.items():
            importlib.import_module(name)
            _mark_of(file).touch()
        os._exit(0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


def main() -> int:
    """Compile the kernels of the kinds that the command line names, or of all kinds."""
    linux.end_with_parent(os.getppid())
    match sys.argv[1:]:
        case ["--all"]:
            modules = _all_modules()
        case []:
            modules = _modules(None)
        case names:  # after "--" there may be none, for the kernels that all kinds share
            modules = _modules([name for name in names if name != "--"])
    missing = _missing(modules)
    return 1 if missing and compile_modules(missing) else 0


if __name__ == "__main__":
    sys.exit(main())
