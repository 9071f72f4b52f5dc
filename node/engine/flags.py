"""Flags that the compiled generations of a cell report beside a message, as bits of one number."""

REACHED = 1
"""The cell proposes to stop: its champion meets the target."""
STALLED = 2
"""The cell proposes to stop: its champion has not changed for too long."""
STOPS = 4
"""The cell stops after this generation."""
REFUSED = 8
"""The cell has refused a neighbour's message."""
UNSOUND = 16
"""An offspring's fitness is not a number; the generation was not completed."""
