"""The torque levels of stretches, which the coding and the compiled code share."""

LEVELS = 8
"""On a stretch of level s no more than s/8 of each torque limit may be used."""
