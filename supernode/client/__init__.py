"""Talk to a running cluster: find it, send requests, follow jobs. Every other room that needs a cluster uses this one.

A client is an ordinary Zenoh client. It sends requests to the coordinator, and it receives what spy and coordinator
publish about jobs. Messages may get lost, repeated or delayed while a router or a coordinator restarts; the job's feed
puts them in order again.

Read `client` first: the blocking and the asyncio client, which programs use. Below it, `link` is the session with one
cluster, `job_feed` holds what is known of one job, and `cluster_info` is the entry in the state folder by which a
cluster is found.
"""
