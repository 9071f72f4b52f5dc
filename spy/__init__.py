"""The spy: a process at the root cell that collects the best solutions, verifies them, and judges the run.

Read `process` first: it says what the spy listens to, and which thread does what. `collector` evaluates each better
champion itself before it passes it on; `tally` adds up the nodes' counters; `verification` judges an epoch that has
ended.

The other modules are of use to the coordinator and the simulator too, which write results: `judgement` is how an epoch
ended, `result` is a job's result, `past` sums up its ended epochs, `improvement_records` lists its improvements by
generation, `run_log` writes the run log, `terminal` shows progress, and `least_improvement` says which improvements are
worth a line.
"""
