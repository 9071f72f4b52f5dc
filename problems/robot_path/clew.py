"""Sizes of a clew, the genome of the paper recipe; see `problems.robot_path.paper_kernels`."""

MOST_LANDMARKS = 24
ROUNDS = 2
"""Rounds of Manhattan moves in a motion."""
