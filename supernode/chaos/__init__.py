"""Try a cluster under faults: kill and stop its processes while a job runs, and see what was lost.

Read `trial` first: it carries out faults on the processes of a cluster that it starts. `schedule` draws the faults from
a seed. `report` says what was done and what was lost. The command is `supernode chaos`.
"""
