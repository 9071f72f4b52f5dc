"""Planning for a holonomic mobile robot by rotate and move commands (Ahuactzin et al. 1992, §5)."""

from problems.mobile_robot.planner import MobileRobot

__all__ = ["MobileRobot"]
