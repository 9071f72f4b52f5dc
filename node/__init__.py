"""The nodes of a cluster: a cell's deme, breeding and exchange, the process around it, and its simulation."""

from node.cell import Cell
from node.plan import Plan
from node.simulation import simulate

__all__ = ["Cell", "Plan", "simulate"]
