"""A whole cluster in one process: the production code on simulated threads, clock, network and processes.

Read `world` first, then `cluster` and `trial`.

`world` is the clock and the scheduler of tasks (greenlets); whatever happens is drawn from one seed, so a seed repeats
a run exactly. `stand_ins` replaces `time`, `threading`, `queue`, `zenoh` and a few more in the modules of nodes, spy
and coordinator; `thread_types` and `network` are what it puts there. `cluster` starts processes and replaces dead ones,
as the zygote does. `trial` runs a client's jobs under faults, which `plans` draws, and `invariants` checks what must
hold. `campaign` runs many trials. The modules under test do not know that they are simulated.
"""
