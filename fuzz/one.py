"""Fuzz one target in this process by libFuzzer, guided by which branches of Python code an input takes.

Usage: python -m fuzz.one TARGET [libFuzzer's options] [FOLDER of inputs, or one FILE to repeat]

The code that reads is instrumented as it is imported; compiled code is not, since numba compiles from the bytecode.
"""

import resource
import sys
import time
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

import atheris

from fuzz.limits import MOST_MEGABYTES, MOST_SECONDS

if TYPE_CHECKING:
    from fuzz.target import Target

_ROOT = Path(__file__).resolve().parents[1]
_PACKAGES = ("coordinator", "problems", "spy", "supernode", "topologies", "wire")
_READERS = ("tomllib", "yaml")  # of the standard library, and of others
_COMPILED = ("lowlevel.compiled", "numba")


class TookTooMuch(Exception):  # noqa: N818 - it is a finding
    """An input took too much time, or has made this process too large, if only for a moment."""


def main() -> None:
    """Import the target, and give it inputs until libFuzzer's options end it."""
    name, *options = sys.argv[1:]
    with atheris.instrument_imports(include=[*_PACKAGES, *_READERS], exclude=_compiled_modules()):
        from fuzz.targets import TARGETS
    target = TARGETS[name]
    seeds = target.seeds()
    for seed in seeds:  # the rest is imported, and compiled code is loaded
        target.read(seed)
    atheris.Setup([sys.argv[0], *options], _reading(target), custom_mutator=_changing(target, seeds))
    atheris.Fuzz()


def _compiled_modules() -> list[str]:
    """Return the names of modules that numba compiles parts of."""
    names = []
    for path in (each for package in _PACKAGES for each in (_ROOT / package).rglob("*.py")):
        if any(word in path.read_text(encoding="utf-8") for word in _COMPILED):
            names.append(".".join(path.relative_to(_ROOT).with_suffix("").parts))
    return names


def _reading(target: "Target") -> Any:
    def read(data: bytes) -> None:
        before = time.process_time()
        target.read(data)
        seconds = time.process_time() - before
        megabytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10
        if megabytes > MOST_MEGABYTES or seconds > MOST_SECONDS:
            raise TookTooMuch(f"{seconds:.1f} s of CPU time, {megabytes} MB")

    return read


def _changing(target: "Target", seeds: list[bytes]) -> Any:
    """Return libFuzzer's mutator: half of the time its own, which knows what the code compares bytes with."""
    from fuzz.mutation import mutated

    def change(data: bytes, most: int, seed: int) -> bytes:
        rng = Random(seed)
        if rng.random() < 0.5:
            return bytes(atheris.Mutate(data, most))
        return mutated(data, target.form, seeds, rng)[:most]

    return change


if __name__ == "__main__":
    main()
