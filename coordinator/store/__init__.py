"""Keep everything in a database that must survive the coordinator.

Read `job_store` first, then `recorder`.

`database` opens SQLite or PostgreSQL and claims it for this process; `sessions` shares out its transactions. On them
`job_reader` reads jobs and `job_store` writes them. `tables` declares the tables, `stored_job` says what a job looks
like outside of them, and `tidying` bounds what a job with many epochs takes. `record_book` keeps what happened in the
jobs: improvements, histories, statistics and the log. `recorder` gets all reports of the dispatcher, writes them on a
thread of its own, and publishes a state only once it is on disk.
"""
