"""A problem that was made in Python, without a file."""

from dataclasses import dataclass, field
from pathlib import Path

from problems import registry
from problems.file import ProblemFile
from problems.problem import Problem
from problems.run import Run


@dataclass(frozen=True)
class MadeProblem(ProblemFile):
    """A problem that was made in Python, where one from a file is expected.

    Attributes:
        model: its class, which need not be in a module that can be imported.
    """

    model: type[Problem] = field(kw_only=True)

    @staticmethod
    def of(problem: Problem) -> "MadeProblem":
        """With the fields of ``problem``; the kind of a user's own one is the name of its class."""
        model = type(problem)
        kind = problem.kind if registry.is_built_in(problem.kind) else f"{model.__module__}:{model.__qualname__}"
        fields = problem.model_dump(mode="json", exclude_unset=True) | {"kind": kind}
        return MadeProblem(model.__name__, fields, Run.model_validate({}), Path(), model=model)

    def find_model(self) -> type[Problem]:
        """The class that it was made of."""
        return self.model
