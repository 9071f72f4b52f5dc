"""Grid navigation on terrain of fuzzy difficulty, path and trajectory together (Fries)."""

from problems.terrain.problem import Slope, Terrain

__all__ = ["Slope", "Terrain"]
