"""Talk to a running cluster: find it, send requests, follow jobs. Other subpackages reach a cluster only by this.

A client is an ordinary Zenoh client. It sends requests to the coordinator, and it receives what spy and coordinator
publish about jobs. Messages may get lost, repeated or delayed while a router or a coordinator restarts; a job's feed
puts them in order again.

Read `async_client` first: it and the handles of jobs in `async_job` are the implementation. `client` runs it in a
`loop_thread`, for programs that block. Below them, `job_tracker` keeps a `job_feed` of each job, `link` is the session
with one cluster, and `cluster_info` is the entry in the state folder by which a cluster is found.
"""
