"""The commands, one module each: what it does, its arguments, an example, and `run`."""
