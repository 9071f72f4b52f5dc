"""Start, supervise and end the cluster of `supernode up`, or of a single run that a dashboard shows.

Read `supervisor` first: it starts router, coordinator, spy, nodes and dashboard, and replaces those that die.
`detached` moves it to the background.
"""
