"""The work of a generation on a cell's arrays: inbox, breeding, champions and stops, outbox, and the digest of all.

Read `rule` first: one cell's generation, step by step. `generation` calls its parts from Python, where a problem's
fitness is not compiled; `compiled_generation` makes one compiled call of them. `rows` has the same rule independently,
for the simulator, which breeds many cells at once. `kernels` has what both share: champions, stops, emigrants,
improvements.

`inbox` and `outbox` hold the messages of the neighbours and those of the cell; `history` digests each generation.
`cell_table` and `layout` say where compiled code finds a cell's arrays; `state` is a cell's state as bytes,
`state_size` how long that is; `flags` are what a generation reports beside its message.

Pure: no input, no output, no clock, and no thread of its own. `node.cell` and the simulator use it.
"""
