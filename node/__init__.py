"""The nodes of a cluster: a cell's deme, breeding and exchange, the process around it, and its simulation.

Read `cell` first, then `events`, `engine` and `driver`.

- The cell: `cell` is its state machine, `events` its input and output, `plan` what all cells of an epoch must agree on;
  `engine` breeds. `stimuli` keeps what a cell was given lately, for errors.
- The process: `process` sets it up and states which thread may touch what; `driver` decides when the cell takes a step,
  and on which thread; `commands` takes commands, `epochs` changes from one epoch to the next, `assignment` is the epoch
  that a node is in. `node_config` is what a process must know to start.
- The exchange: `links` connects neighbours; `fast_path` takes their messages in compiled code, and `ordinary_path`
  stands in for it where it must not be used. `queries` ends queries; `telemetry` sends counters and log records.
- Cores: `turn_taking` and `core_token` share a core among many async nodes; `cpu_affinity` places nodes on cores.
- Without nodes: `simulation` runs an epoch in one process, `replay` all epochs of a recorded run; `fingerprint` is what
  a replay depends on.
"""
