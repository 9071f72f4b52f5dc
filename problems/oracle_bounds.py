"""Translate an oracle's answer into its consequences for a run: no solution exists, or fitness has a lower bound."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

from problems.file import ProblemFile
from problems.guard import oracle_answer, solved_at
from problems.problem import Answer, Problem

_TOLERANCE = 1e-6  # relative, but absolute below 1
_LONGEST = 500  # characters of a method or message


@dataclass(frozen=True)
class OracleBounds:
    """Bounds that hold for every solution of a problem.

    Attributes:
        hopeless: whether no solution is feasible, or none is as good as the problem's own `solved_at`.
        least: a lower bound of the fitness; None if no bound is known or no solution is feasible.
        is_optimum: whether some solution attains the bound.
        method: how the bound was obtained, in words.
    """

    hopeless: bool
    least: float | None
    is_optimum: bool
    method: str

    @property
    def words(self) -> str | None:
        """The sentence that results show; None if there is nothing to report."""
        if self.hopeless:
            least = "" if self.least is None else f"; no fitness is below {self.least:.6g}"
            return f"there is no way: {self.method}{least}"
        return f"the optimum is {self.least:.6g}, by {self.method}" if self.is_optimum else None

    def is_reached_by(self, fitness: float) -> bool:
        """Return whether no solution can be better than ``fitness``, up to rounding."""
        return self.least is not None and fitness <= self.least + _tolerance(self.least)

    def to_json(self) -> str:
        """Return the bounds as JSON, for a message to another process."""
        return json.dumps([self.hopeless, self.least, self.is_optimum, self.method])

    @staticmethod
    def from_json(text: str) -> OracleBounds:
        """Return the bounds that `to_json` has encoded.

        Raises:
            ValueError: if ``text`` is not the output of `to_json`.
        """
        match json.loads(text):
            case [bool(hopeless), float() | None as least, bool(is_optimum), str(method)]:
                return OracleBounds(hopeless, least, is_optimum, method)
        raise ValueError(f"expected what an oracle foretells, found {text[:_LONGEST]!r}")


def has_oracle(model: type[Problem]) -> bool:
    """Return whether problems of this class have an oracle, and its bounds may end a run."""
    return model.oracle_decides and model.oracle is not Problem.oracle


def solve_exactly(file: ProblemFile, problem: Problem) -> OracleBounds:
    """Call the problem's oracle and return what its answer means for a run of ``file``.

    Raises:
        BadInput: if there is no oracle for this problem.
        EvaluationFailed: if the oracle raises, or returns no `Answer`.
    """
    return meaning(oracle_answer(problem), solved_at(problem) if file.run.target is None else None)


def meaning(answer: Answer, target: float | None) -> OracleBounds:
    """Return what an oracle's answer means for a run.

    Args:
        answer: the answer of the problem's oracle.
        target: the fitness that solves the problem; None if there is none. A target that the user has set for the run
            counts as none: setting one that cannot be reached is the way to search until a limit.
    """
    method = answer.method[:_LONGEST]
    if answer.meaning == "upper bound":  # it excludes nothing: better solutions may exist
        return OracleBounds(False, None, False, method)
    if math.isinf(answer.fitness):  # no solution is feasible
        return OracleBounds(True, None, False, method)
    hopeless = target is not None and answer.fitness > target + _tolerance(target)
    return OracleBounds(hopeless, float(answer.fitness), answer.meaning == "optimum", method)


def _tolerance(fitness: float) -> float:
    """Return the difference up to which two values count as equal that were computed in different ways."""
    return _TOLERANCE * max(1.0, abs(fitness))
