"""Everything that travels between processes: key expressions, messages and their limits, and Zenoh sessions."""
