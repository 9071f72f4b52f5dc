"""The spy: a process at the root cell that collects the best solutions, verifies them, and judges the run."""
