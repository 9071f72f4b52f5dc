"""A model of a running cluster, kept up to date: the dashboard and the terminal's screen both show it.

Read `view` first: it holds the latest of everything that was received, and nothing else, so that it does not grow.
`watcher` feeds it: it listens to one cluster, asks now and then, and connects again when the cluster was away.
"""
