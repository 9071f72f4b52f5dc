"""The dashboard shows a cluster in a browser. It is a process of its own and a client like any other.

Nodes and spy do nothing for it, so it does not slow them down, and it can be killed and restarted at any time. What it
shows is the model of the cluster in `supernode.live`.

Read `server` first: it puts the web server together. `pages` answers with pages, whose scripts are in `static/`; `data`
answers what the scripts ask for, from what all requests share (`shared`). `streams` sends live updates, and `scenes`
draws pictures of solutions, or has `animations` describe how they move.

Every request passes `guard` before anything else sees it. `tokens` reads who may visit, `credentials` tells what a
visitor may do, `login` logs browsers in and out, and `limits` counts how often an address does something.

`keeper` belongs to the process that starts the dashboard, `supernode up` or `supernode solve`. The dashboard's own
process begins in `__main__`, and `ending` ends it in order.
"""
