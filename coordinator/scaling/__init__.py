"""Scaling experiments: the cost of solving one problem on tori of several sizes, with confidence intervals."""
