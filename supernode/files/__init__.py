"""Read and write single files: outputs, TOML, and files that only their owner may read. Nothing here knows a cluster.

Read `outputs` first: every file that a command writes is written there. `private_file` reads files with a token or a
secret, and `secret_file` makes the secret of a cluster.
"""
