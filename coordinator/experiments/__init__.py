"""Scaling experiments: the cost of solving one problem on tori of several sizes, with confidence intervals.

Read `experiment` first: it has the parameters, and the runs that follow from them.

`runner` makes the runs that are still missing, each measured by `measure`, and writes each to the `journal` as soon as
it has ended. `describe` notes what is needed to repeat the experiment. From the journal alone `summary` computes costs
and speed-ups, with the intervals of `statistics` and the verdicts of `comparison`. `outputs` writes all that is
derived: tables (`tables`), pictures (`plots`), the conclusions in words (`words`) and the report (`report`). `pages`
renders a report as one HTML file, for other parts of the project too.
"""
