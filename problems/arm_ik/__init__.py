"""Inverse kinematics of a planar arm among obstacles (Ahuactzin, Talbi, Bessière, Mazer 1992, §3)."""

from problems.arm_ik.model import Arm, ArmIk

__all__ = ["Arm", "ArmIk"]
