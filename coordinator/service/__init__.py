"""The coordinator as a process: take jobs from clients, have them run, and continue after the death of a process.

Read `process` first, then `request_handler`.

`process` receives requests and hands them to suitable threads: `waiting_room` limits how many wait, `lanes` keeps the
changes of one job in order. `request_handler` answers them. It checks a submitted problem (`checking`, in a process of
its own where a user's code must run), writes the job to the store and hands it to the dispatcher.

`service_dispatcher` is a dispatcher of nodes that other processes have launched; `roster` follows their processes by
liveliness tokens. It has two forms: `launched`, for a cluster that one zygote has launched on this machine, and
`joined`, for nodes that come and go with their hosts, which `host_book` records.
"""
