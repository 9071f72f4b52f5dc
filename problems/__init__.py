"""The planners: the base class of problems, the reading of problem files, and the built-in kinds.

Read `problem` first: the base class of every planner, and the values that its methods return. Then read the package of
one planner, such as `arm_ik`; all have the same modules, which docs/architecture.md lists.

- From a file to a problem: `file` reads it, `registry` finds the kind that it names, `tables` and `angles` are what
  fields are made of, `run` has the settings of the run, `modules` says which users' modules may be imported.
  `in_memory` is for problems made in Python. `errors` phrases what is wrong.
- Around a problem: `guard` validates what a user's methods return; `advice` has hints for a run that has stalled;
  `oracle_process` and `oracle_bounds` run an oracle beside the search and use its answer; `motion` and `profile` make
  motions over time.
- For several planners: `plane`, `outlines`, `vectors` and `nearest`, and the package `planar_arm`.
"""

from problems.errors import BadInput, EvaluationFailed
from problems.file import ProblemFile, load
from problems.guard import guarded
from problems.problem import Answer, Clearance, Problem, Solution, Verdict
from problems.run import Run
from problems.tables import RecipeName, Table, quantity

__all__ = [
    "Answer",
    "BadInput",
    "Clearance",
    "EvaluationFailed",
    "Problem",
    "ProblemFile",
    "RecipeName",
    "Run",
    "Solution",
    "Table",
    "Verdict",
    "guarded",
    "load",
    "quantity",
]
