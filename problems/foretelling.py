"""Translates an oracle's answer into what it means for a run: there is no way, or no fitness is below a bound."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass

from problems.file import ProblemFile
from problems.guard import foretold, solved_at
from problems.problem import Answer, Problem

_TOLERANCE = 1e-6
_LONGEST = 500  # characters of a method


@dataclass(frozen=True)
class Foretold:
    """Bounds that hold for every solution of a problem.

    Attributes:
        hopeless: whether none is feasible, or as fit as the problem itself calls solved.
        least: none has a lower fitness; None if that is not known, or there is none at all.
        is_optimum: whether some solution has that fitness.
        method: how that was got, in words.
    """

    hopeless: bool
    least: float | None
    is_optimum: bool
    method: str

    @property
    def words(self) -> str | None:
        """What a result says of it; None if there is nothing to say."""
        if self.hopeless:
            least = "" if self.least is None else f"; no fitness is below {self.least:.6g}"
            return f"there is no way: {self.method}{least}"
        return f"the optimum is {self.least:.6g}, by {self.method}" if self.is_optimum else None

    def is_reached_by(self, fitness: float) -> bool:
        """Whether nothing can be better than that fitness."""
        return self.least is not None and fitness <= self.least + _tolerance(self.least)

    def to_json(self) -> str:
        """For a message to another process."""
        return json.dumps([self.hopeless, self.least, self.is_optimum, self.method])

    @staticmethod
    def from_json(text: str) -> Foretold:
        """The inverse of `to_json`.

        Raises:
            ValueError: if the text is something else.
        """
        match json.loads(text):
            case [bool(hopeless), float() | None as least, bool(is_optimum), str(method)]:
                return Foretold(hopeless, least, is_optimum, method)
        raise ValueError(f"expected what an oracle foretells, found {text[:_LONGEST]!r}")


def has_oracle(model: type[Problem]) -> bool:
    """Whether problems of this class have an oracle whose answers hold for a run."""
    return model.oracle_decides and model.oracle is not Problem.oracle


def solve_exactly(file: ProblemFile, problem: Problem) -> Foretold:
    """Ask the oracle of a problem, made of ``file``.

    Raises:
        BadInput: if there is no oracle for this problem.
        EvaluationFailed: if the oracle breaks.
    """
    return meaning(foretold(problem), solved_at(problem) if file.run.target is None else None)


def meaning(answer: Answer, target: float | None) -> Foretold:
    """What ``answer`` means where a fitness of ``target`` solves the problem; None if nothing does.

    A target that a user sets for a run is none: one that no solution can reach is how to search up to a limit.
    """
    method = answer.method[:_LONGEST]
    if answer.meaning == "upper bound":
        return Foretold(False, None, False, method)
    if math.isinf(answer.fitness):
        return Foretold(True, None, False, method)
    hopeless = target is not None and answer.fitness > target + _tolerance(target)
    return Foretold(hopeless, float(answer.fitness), answer.meaning == "optimum", method)


def _tolerance(fitness: float) -> float:
    """By how much two figures may differ that were computed in different ways."""
    return _TOLERANCE * max(1.0, abs(fitness))
