"""Problems that were made in Python instead of read from a file."""

from dataclasses import dataclass, field
from pathlib import Path

from problems import registry
from problems.file import ProblemFile, load
from problems.problem import Problem
from problems.run import Run


@dataclass(frozen=True)
class InMemoryProblem(ProblemFile):
    """A problem made in Python, for functions that expect a problem file.

    Attributes:
        model: the problem's class. It is kept, because it need not be in a module that can be imported.
    """

    model: type[Problem] = field(kw_only=True)

    @staticmethod
    def of(problem: Problem) -> "InMemoryProblem":
        """Return a problem file with the fields of ``problem``; a user's own kind is named after its class."""
        model = type(problem)
        kind = problem.kind if registry.is_built_in(problem.kind) else f"{model.__module__}:{model.__qualname__}"
        fields = problem.model_dump(mode="json", exclude_unset=True) | {"kind": kind}
        return InMemoryProblem(model.__name__, fields, Run.model_validate({}), Path(), model=model)

    def find_model(self) -> type[Problem]:
        """Return the class of the problem that this was made of, without an import."""
        return self.model


def file_of(problem: ProblemFile | Problem | str | Path) -> ProblemFile:
    """Return a problem file: the given one, the one at a path, or one with the fields of a problem made in Python.

    Raises:
        BadInput: if the file at the path cannot be used.
    """
    if isinstance(problem, Problem):
        return InMemoryProblem.of(problem)
    return problem if isinstance(problem, ProblemFile) else load(problem)
