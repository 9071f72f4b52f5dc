"""The planners: the base class of problems, the reading of problem files, and the built-in kinds."""

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
