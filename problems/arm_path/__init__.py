"""Manhattan motions of a planar arm among obstacles (Ahuactzin, Talbi, Bessière, Mazer 1992, §4)."""

from problems.arm_path.planner import ArmPath

__all__ = ["ArmPath"]
