"""Clusters on many machines, started by somebody else's engine: Slurm, Kubernetes, MPI or plain hosts.

`surroundings` reads what such an engine tells a process about its machine. `slurm.sbatch` and `kubernetes.yaml` are the
files that `supernode deploy` fills in. docs/deploy.md is the contract that they all keep.
"""
