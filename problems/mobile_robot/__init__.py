"""Planning for a holonomic mobile robot by rotate and move commands (Ahuactzin et al. 1992, §5)."""

from problems.mobile_robot.model import Body, MobileRobot

__all__ = ["Body", "MobileRobot"]
