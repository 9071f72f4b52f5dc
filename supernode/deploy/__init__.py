"""Clusters on many machines, started by somebody else's engine: Slurm, Kubernetes, MPI or plain hosts.

Read `surroundings` first: what such an engine tells a process about its machine. `slurm.sbatch` and `kubernetes.yaml`
are the files that `supernode deploy` fills in. `ray_cluster` starts the processes as actors of Ray. docs/deploy.md is
the contract that they all keep.
"""
