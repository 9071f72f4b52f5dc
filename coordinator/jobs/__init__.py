"""Run jobs on the nodes of one cluster, from the queue to the result.

Read `dispatcher` first, then `conductor`.

A job comes to the dispatcher. The scheduler (`scheduler`, pure) decides when it starts, and on which nodes. Each job
that runs has a conductor on a thread of its own. The conductor sends commands to the nodes and to the spy, and waits at
one queue for answers, reports, requests and news of deaths (`calls`). What it knows of the job is in `conducted_job`,
the epochs of the job in `epochs`. Each phase of conducting it has a class:

- `preparing`: prepare nodes and spy for an epoch, and begin it
- `running`: wait for the reports of the cells, and pass on stops and changes meanwhile
- `changing`: begin the next epoch, for an update, another topology or another attempt
- `replacing`: continue after the death of processes, or of a coordinator
- `ending`: have the spy judge the epoch, and let the processes forget the job

`job` has what the submitter sees of a job, and the messages to its conductor; `states` has the table of which state may
follow which. `consulting` asks a problem's oracle in a process beside the search. `hooks` states the interfaces: what
the dispatcher reports, and what a service asks of a dispatcher. `node_hosts` knows the addresses of nodes on several
machines, `listener` passes on what spy and nodes publish, and `alarms` calls when a deadline has come.

Nothing here knows the store, a client, or how processes are launched.
"""
