"""What a person sees on a terminal: a job while it runs, its result in words, and a cluster as a whole.

Read `following` first: it prints the improvements of a job as they come. `present` presents the result, and turns it
into an exit code. `screen` draws a cluster or a job in colour for `supernode watch`; `table` aligns columns.
"""
