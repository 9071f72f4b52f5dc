"""Clusters on many machines, started by somebody else's engine: Slurm, Kubernetes, MPI, Ray or ssh.

Read `surroundings` first: what an engine tells a process about its machine. `slurm.sbatch` and `kubernetes.yaml` are
the files that `supernode deploy` fills in. `ray_cluster` and `ssh_cluster` are started by `supernode up --on`, or from
Python; `engine_cluster` is what they have in common. `lifeline` ties an agent to the machine that has started it. The
contract that they all keep is docs/deploy.md.
"""
