"""Limit what an input may take; more is a finding."""

MOST_SECONDS = 5.0  # of CPU time
GIVEN_UP_AFTER = 120  # seconds of wall-clock time, in which even a busy machine finds five of CPU time
MOST_MEGABYTES = 2048
MOST_BYTES = 1 << 16
"""The longest input that is tried. Reading some formats takes time that grows faster than the length."""
