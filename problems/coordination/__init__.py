"""Coordination of two manipulators on given paths (Riquelme, Ridao, Camacho, Toro)."""

from problems.coordination.planner import Coordination

__all__ = ["Coordination"]
