"""Known functions, whose optimum is no secret: for tests, comparisons and load."""

from problems.function.problem import Function

__all__ = ["Function"]
