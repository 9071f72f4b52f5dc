"""Everything that travels between processes: key expressions, messages and their limits, and Zenoh sessions.

Read `keys` first: it names every place where something is published or asked for, and by which process.

- Between neighbours: `exchange` is the message of each exchange; compiled code reads and writes it. `champion` is the
  best individual in it, `limits` are what a receiver accepts.
- Between coordinator, nodes and spy: `control` has the commands and their answers, `report` what a cell sends at its
  end, `hosts` how nodes of other machines join. `seal` proves that a command comes from the cluster.
- For anybody: `news` has counters, statistics, improvements and log records; `jobs` has clients' requests and answers.
- How: `strict` reads msgpack with limits, `plain` makes values fit for JSON, and `printable` makes text fit for a
  terminal; `sessions` configures Zenoh, and `callbacks` are called on its network thread.
"""
