"""One cell's life: the deme, the breeding, the exchange, and the process around them."""

from node.cell import Cell
from node.plan import Plan
from node.simulation import simulate

__all__ = ["Cell", "Plan", "simulate"]
