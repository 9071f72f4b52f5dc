"""Inverse kinematics of a robot from a URDF: configurations that bring a link to a pose, clear of all obstacles."""

from problems.robot_ik.planner import RobotIk

__all__ = ["RobotIk"]
