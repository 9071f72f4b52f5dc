"""Grid navigation on terrain of fuzzy difficulty, path and trajectory together (Fries)."""

from problems.terrain.planner import Terrain

__all__ = ["Terrain"]
