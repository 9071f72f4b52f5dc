"""Paths among spheres in configuration spaces of two to seven dimensions (Eldershaw and Cameron)."""

from problems.sphere_path.planner import SpherePath

__all__ = ["SpherePath"]
