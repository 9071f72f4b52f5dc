"""Describe what is fuzzed: a function that reads bytes, and inputs to begin with."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fuzz.forms import Form

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Target:
    """A reader of foreign input.

    Attributes:
        name: its name on the command line.
        form: the format of most of its inputs.
        seeds: returns inputs that are right.
        read: reads any bytes; returns whether they are a right input, and raises only if the reader has a fault.
    """

    name: str
    form: Form
    seeds: Callable[[], list[bytes]]
    read: Callable[[bytes], bool]
