"""The exit codes of the commands."""

OK = 0
"""The target was reached, or there is none and the result is feasible."""
FAILED = 1
"""The cluster, or a user's problem, broke."""
BAD_INPUT = 2
"""Bad usage, or a bad problem file."""
NOT_REACHED = 3
"""The run ended otherwise (the best found is still printed); or a check rejects."""
INTERRUPTED = 130
"""Ctrl-C."""
