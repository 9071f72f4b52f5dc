"""Functions with a known optimum: for tests, comparisons and load."""

from problems.function.model import Function

__all__ = ["Function"]
