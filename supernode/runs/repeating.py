"""Repeat a run from its result, and check that the repetition is bit-identical."""

import json
from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

from node.fingerprint import fingerprint
from node.replay import Epoch, epochs_of
from problems import BadInput, ProblemFile
from problems.errors import shorten
from spy.result import Result
from supernode.runs.results import read_table
from topologies import ROOT
from wire.report import Proposal, reason_of
from wire.strict import Rejected


@dataclass(frozen=True)
class Recorded:
    """The recorded run in the result file ``name``.

    Attributes:
        name: the name of the file, for errors.
        run: the settings of the run.
        directives: the recorded changes and stops.
        problem: the digest of the problem at the end of the run.
        history: the digest over all demes of all generations.
        versions: the versions that the nodes ran on.
        stops: the stops from outside that ended the last epoch, if any did.
    """

    name: str
    run: dict[str, Any]
    directives: list[dict[str, Any]]
    problem: str
    history: str
    versions: dict[str, Any]
    stops: tuple[Proposal, ...]

    @staticmethod
    def read(name: str, settings: Collection[str]) -> "Recorded":
        """Read the result in a file.

        Args:
            name: the name of the file.
            settings: the settings given on the command line; must be empty, since those of the result hold.

        Raises:
            BadInput: if a setting is given, or the file holds no result that can be repeated.
        """
        if settings:
            raise BadInput(f"--replay: the settings are those of the result, expected no other, found {min(settings)}")
        found = read_table(name)
        run, directives, versions = found.get("run"), found.get("directives"), found.get("versions")
        problem, history = found.get("problem_sha256"), found.get("history_sha256")
        if not (isinstance(run, dict) and isinstance(directives, list) and isinstance(versions, dict)):
            raise BadInput(f"{name}: expected a result as `solve --json` prints it, found {shorten(found)}")
        if not isinstance(problem, str):
            raise BadInput(f"{name}: problem_sha256: expected one, found {shorten(problem)}")
        if (mode := run.get("mode")) != "lockstep":
            raise BadInput(f"{name}: mode: expected lockstep, which alone can be repeated, found {shorten(mode)}")
        if not isinstance(history, str):
            raise BadInput(
                f"{name}: history_sha256: expected one, found {shorten(history)}: there is nothing to repeat"
            )
        return Recorded(name, run, directives, problem, history, versions, _stops(directives, name))

    def epochs(self, file: ProblemFile) -> list[Epoch]:
        """Return the epochs of the recorded run, which began with the problem ``file``.

        Raises:
            BadInput: if the run cannot have begun with it, or a directive is wrong.
        """
        # Read the recorded settings as those of a problem file, so that they are validated in the same way.
        values = [self.name, file.fields, self.run, str(file.folder)]
        began = replace(file, run=ProblemFile.from_json(json.dumps(values)).run)
        try:
            epochs = epochs_of(began, self.directives)
        except BadInput as error:
            raise BadInput(f"{self.name}: {error}") from None
        if epochs[-1].file.sha256 != self.problem:
            raise BadInput(f"{self.name}: the result is of another problem than {file.name}: problem_sha256 differs")
        return epochs

    def complaint(self, result: Result) -> str | None:
        """Return why the repetition ``result`` is not the recorded run, or None if it is the same."""
        if result.history_sha256 == self.history:
            return None
        here = fingerprint()
        others = [name for name in sorted(here) if here[name] != self.versions.get(name)]
        why = f"; versions differ: {', '.join(others)}" if others else ""
        return f"{self.name}: history_sha256: expected {self.history}, found {result.history_sha256}{why}"


def _stops(directives: list[Any], name: str) -> tuple[Proposal, ...]:
    """Return the stops among ``directives`` as proposals of the root; other errors in them are found by `epochs`."""
    stops = []
    for each in directives:
        if isinstance(each, dict) and each.get("do") == "stop" and type(each.get("generation")) is int:
            try:
                reason = reason_of(each.get("reason"))
            except Rejected as error:
                raise BadInput(
                    f"{name}: directives: reason: expected one, found {shorten(each.get('reason'))}"
                ) from error
            stops.append(Proposal(each["generation"], reason, ROOT, each["generation"]))
    return tuple(stops)
