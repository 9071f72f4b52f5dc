"""Who neighbours whom: pure graphs, without any input or output."""

from topologies.parse import parse
from topologies.topology import Topology
from topologies.torus import Torus

__all__ = ["Topology", "Torus", "parse"]
