"""The spy at the root: collect the best solutions, verify them, keep and show them."""
