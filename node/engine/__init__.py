"""What a generation does to a cell's arrays: inbox, breeding, champions and stops, outbox, and the digest of it all.

Pure: no input, no output, no clock, and no thread of its own. `node.cell` and the simulator use it.
"""
