"""From the text that people write to a topology."""

import re

from topologies.topology import Topology
from topologies.torus import Torus

MOST_CELLS = 1 << 20


def parse(spec: str) -> Topology:
    """The topology named by ``spec``, such as ``"torus 8x8"``.

    Raises:
        ValueError: says what was expected and what was found.
    """
    match = re.fullmatch(r"\s*torus\s+(\d{1,7})\s*[x×]\s*(\d{1,7})\s*", spec)
    if match is None:
        raise ValueError(f'expected a topology such as "torus 4x4", found {spec!r}')
    torus = Torus(int(match[1]), int(match[2]))
    if torus.cells > MOST_CELLS:
        raise ValueError(f"expected at most {MOST_CELLS} cells, found {torus.cells}")
    return torus
