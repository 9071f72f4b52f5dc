"""Paths of robots described by URDF among obstacles (Ahuactzin's Ariadne's clew, and what has been found since)."""

from problems.robot_path.planner import RobotPath

__all__ = ["RobotPath"]
