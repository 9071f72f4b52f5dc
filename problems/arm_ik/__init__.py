"""Inverse kinematics of a planar arm among obstacles (Ahuactzin, Talbi, Bessière, Mazer 1992, §3)."""

from problems.arm_ik.planner import ArmIk

__all__ = ["ArmIk"]
