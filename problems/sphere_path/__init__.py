"""Paths among spheres in configuration spaces of two to seven dimensions (Eldershaw and Cameron)."""

from problems.sphere_path.model import SpherePath

__all__ = ["SpherePath"]
