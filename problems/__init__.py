"""The planners: the base class of problems, the reading of problem files, and the built-in kinds."""

from problems.errors import BadInput, EvaluationFailed
from problems.file import ProblemFile, load
from problems.guard import guarded
from problems.problem import Answer, Clearance, Problem, RecipeName, Solution, Table, Verdict, quantity
from problems.run import Run

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
