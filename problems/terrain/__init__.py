"""Grid navigation on terrain of fuzzy difficulty, path and trajectory together (Fries)."""

from problems.terrain.model import Slope, Terrain

__all__ = ["Slope", "Terrain"]
