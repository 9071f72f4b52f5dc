"""Runs in this process, and what can be done with a run's result without a cluster.

Read `simulation` first: it runs a job generation by generation, bit-identical to a lockstep run on processes. `results`
reads results, from files and from what a cluster answered. `claims` verifies a result, `repeating` repeats the run that
it came from.
"""
