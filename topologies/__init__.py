"""Who neighbours whom: pure graphs, without any input or output."""

from topologies.parse import parse
from topologies.topology import ROOT, Topology
from topologies.torus import Torus

__all__ = ["ROOT", "Topology", "Torus", "parse"]
