"""The dashboard shows a cluster in a browser. It is a process of its own and a client like any other.

Nodes and spy do nothing for it, so it does not slow them down, and it can be killed and restarted at any time.
"""
