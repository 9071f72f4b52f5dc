"""What travels: key expressions, messages and their limits, Zenoh sessions."""
