"""The planners and their worlds: what a problem is, how its file is read, and which kinds there are."""

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
