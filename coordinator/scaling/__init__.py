"""Scaling experiments: the same problem on tori of several sizes, what it costs, and how sure that is."""
