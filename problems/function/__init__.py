"""Functions with a known optimum: for tests, comparisons and load."""

from problems.function.planner import Function

__all__ = ["Function"]
