"""Minimum-time trajectories of arms under torque limits (Chan and Zalzala 1993)."""

from problems.min_time.planner import MinTime

__all__ = ["MinTime"]
