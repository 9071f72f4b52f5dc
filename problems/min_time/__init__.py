"""Minimum-time trajectories of arms under torque limits (Chan and Zalzala 1993)."""

from problems.min_time.model import Arm, MinTime

__all__ = ["Arm", "MinTime"]
