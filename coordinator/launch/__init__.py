"""Start the processes of a cluster on this machine, replace those that die, and end them all.

Read `zygote` first; the rules by which processes end are in its docstring.

`zygote` is the process that router, spy, nodes and coordinator are forked from; `deaths` counts those of them that die.
`launcher` is the caller's side of it. `router` is what the router's process does, and `refusals` reads from Zenoh's log
what it refused. `compilation` first compiles the kernels that the cache lacks. `host` is a zygote whose nodes join a
cluster elsewhere. `folders` makes the private folders of the sockets, and `sandbox` takes the network from processes
that run users' modules. `capacity` estimates how many nodes the machine can hold, within the limits that `cgroups`
reads. `cluster` has `LocalCluster`: a launched cluster with a dispatcher in the calling process.
"""
