"""Topologies: which cells are neighbours. Pure graphs, without input or output."""

from topologies.grids import Torus, torus_of
from topologies.parse import parse, torus_spec
from topologies.topology import ROOT, Topology, first_neighbour

__all__ = ["ROOT", "Topology", "Torus", "first_neighbour", "parse", "torus_of", "torus_spec"]
