"""A room for a mobile robot, whose shape is still to be said."""

EMPTY_ROOM = """
kind = "mobile-robot"
start = [1.0, 1.0, 0.0]
goal = [3.0, 1.0, 1.5]
bounds = [0.0, 0.0, 8.0, 6.0]
[robot]
"""
