"""Turns the text by which people name a topology into the topology."""

import re
from collections.abc import Callable
from functools import lru_cache

from topologies.graphs import Complete, Hypercube, RandomRegular, Ring, SmallWorld
from topologies.grids import Grid, Moore, Torus
from topologies.topology import Topology

MOST_CELLS = 1 << 20
_KEPT = 8  # a random graph, once it is built, may take a gigabyte
EXAMPLES = (
    "torus 4x4",
    "moore 4x4",
    "grid 4x4",
    "ring 16",
    "complete 16",
    "hypercube 4",
    "random-regular 16 4 seed 1",
    "small-world 16 4 0.1 seed 1",
)

_SHAPE = r"(\d{1,7})\s*[x×]\s*(\d{1,7})"
_COUNT = r"(\d{1,7})"
_SEED = r"(?:\s+seed\s+(\d{1,18}))?"


def _whole(match: re.Match[str]) -> list[int]:
    return [int(group) for group in match.groups()]


def _seed(text: str | None) -> int:
    return 1 if text is None else int(text)


_KINDS: tuple[tuple[str, Callable[[re.Match[str]], Topology]], ...] = (
    (rf"torus\s+{_SHAPE}", lambda match: Torus(*_whole(match))),
    (rf"moore\s+{_SHAPE}", lambda match: Moore(*_whole(match))),
    (rf"grid\s+{_SHAPE}", lambda match: Grid(*_whole(match))),
    (rf"ring\s+{_COUNT}", lambda match: Ring(*_whole(match))),
    (rf"complete\s+{_COUNT}", lambda match: Complete(*_whole(match))),
    (r"hypercube\s+(\d{1,2})", lambda match: Hypercube(*_whole(match))),
    (
        rf"random-regular\s+{_COUNT}\s+{_COUNT}{_SEED}",
        lambda match: RandomRegular(int(match[1]), int(match[2]), _seed(match[3])),
    ),
    (
        rf"small-world\s+{_COUNT}\s+{_COUNT}\s+(\d*\.?\d+(?:e-?\d+)?){_SEED}",
        lambda match: SmallWorld(int(match[1]), int(match[2]), float(match[3]), _seed(match[4])),
    ),
)


def torus_spec(value: object) -> str:
    """Return the spec of the torus with the given rows and columns, which are the text "RxC" or a pair of numbers.

    Raises:
        ValueError: if ``value`` is neither, or there is no such torus.
    """
    match value:
        case str() if re.fullmatch(rf"\s*{_SHAPE}\s*", value):
            spec = f"torus {value}"
        case (int(rows), int(columns)) if not (isinstance(rows, bool) or isinstance(columns, bool)):
            spec = f"torus {rows}x{columns}"
        case _:
            raise ValueError(f'expected rows and columns such as "4x4", found {value!r}')
    return parse(spec).spec


@lru_cache(_KEPT)
def parse(spec: str) -> Topology:
    """Return the topology that ``spec`` names, such as ``"torus 8x8"``; `EXAMPLES` has one of each kind.

    The latest topologies are cached, since building a random graph may take seconds.

    Raises:
        ValueError: if ``spec`` names no topology, or one that is not possible.
    """
    for pattern, make in _KINDS:
        match = re.fullmatch(rf"\s*{pattern}\s*", spec)
        if match is not None:
            topology = make(match)
            if topology.cells > MOST_CELLS:
                raise ValueError(f"expected at most {MOST_CELLS} cells, found {topology.cells}")
            return topology
    examples = ", ".join(f'"{example}"' for example in EXAMPLES)
    raise ValueError(f"expected a topology such as {examples}, found {spec!r}")
