"""Problem files: TOML in, a checked problem and its run settings out."""

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from genetics.coding import Coding
from problems import registry
from problems.digests import digest
from problems.errors import BadInput, blaming_the_update, first_line, shorten
from problems.problem import CHECKED, Problem
from problems.run import Run, with_topology

_FOR_PEOPLE = (BadInput, ValueError)
"""Errors whose messages say all that there is to know."""


@dataclass(frozen=True)
class ProblemFile:
    """A problem as its file states it, and how it is to be run.

    Attributes:
        name: the file's name, for messages.
        fields: the problem's own fields, plain values; a user's problem is checked only where its module may run.
        run: the settings of the ``[run]`` table.
        folder: where a user's module is looked for first.
        attempt: how often the run has begun anew since the problem was last changed.
        attempt_fields: what that has changed of the fields, see `Problem.next_attempt`; the problem is the same.
    """

    name: str
    fields: dict[str, Any]
    run: Run
    folder: Path
    attempt: int = 0
    attempt_fields: dict[str, Any] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """The kind of problem."""
        return str(self.fields["kind"])

    @property
    def sha256(self) -> str:
        """A digest of the problem (not of how it is run, or of an attempt), whatever its order and comments."""
        return digest(self.fields)

    def with_run(self, **settings: Any) -> "ProblemFile":
        """The same problem, run with other settings where one is given (not None); a ``torus`` is a topology.

        Raises:
            BadInput: if a setting is unknown or wrong.
        """
        try:
            settings = with_topology(settings)
        except ValueError as error:
            raise BadInput(f"options: {error}") from None
        given = {name: value for name, value in settings.items() if value is not None}
        merged = self.run.model_dump(exclude_unset=True) | given
        return replace(self, run=_run(merged, self.name, frozenset(given)))

    def changed(self, fields: dict[str, Any], run: dict[str, Any]) -> "ProblemFile":
        """Another world: each of the problem's fields, and of the run's settings, that is given replaces the old one.

        A user's own problem is not checked here. No file is read: what others hold is in the fields already.

        Raises:
            BadInput: if a field is unknown or wrong, or the individuals of the old world could not live in the new one;
                it says that the update is wrong, not this file.
        """
        with blaming_the_update(bool(fields)):
            return self._changed(fields, run)

    def _changed(self, fields: dict[str, Any], run: dict[str, Any]) -> "ProblemFile":
        if fields.get("kind", self.kind) != self.kind:
            raise BadInput(f"{self.name}: kind: expected {self.kind!r} as before, found {shorten(fields['kind'])}")
        if "run" in fields:
            raise BadInput(f"{self.name}: run: expected no [run] in an update, it is for the problem alone")
        kept = {name: value for name, value in self.attempt_fields.items() if name not in fields}
        attempt = 0 if fields else self.attempt
        other = replace(self, fields=self._worked_out(self.fields | fields), attempt=attempt).with_run(**run)
        other = other._with_attempt_fields(kept)
        if registry.is_built_in(self.kind):
            other.go_on_from(self, other.problem())
            other.refuse_unreachable()
        return other

    def next_attempt(self, fields: dict[str, Any]) -> "ProblemFile":
        """The same problem for another attempt, which changes ``fields``, beside what those before it have changed.

        Raises:
            BadInput: if the problem cannot be so. A user's own one is not checked here.
        """
        for name in ("kind", "run"):
            if name in fields:
                raise BadInput(f"{self.name}: next_attempt: expected fields of the problem, found {name}")
        other = replace(self, attempt=self.attempt + 1)
        if not fields:
            return other
        other = other._with_attempt_fields(self.attempt_fields | fields)
        if registry.is_built_in(self.kind):
            other.problem()
        return other

    def tried(self, directives: Sequence[Mapping[str, Any]]) -> "ProblemFile":
        """The same problem after the attempts that a result's directives tell of."""
        file = self
        for directive in directives:
            if directive["do"] == "retry":
                file = file.next_attempt(directive["fields"])
        return file

    def _with_attempt_fields(self, fields: dict[str, Any]) -> "ProblemFile":
        if not fields:
            return replace(self, attempt_fields={})
        whole = self._worked_out(self.fields | fields)
        changed = {name: value for name, value in whole.items() if self.fields.get(name, ...) != value}
        return replace(self, attempt_fields=changed)

    def _worked_out(self, fields: dict[str, Any]) -> dict[str, Any]:
        """See `Problem.work_out`; a user's module is not imported for it."""
        return registry.find(self.kind).work_out(fields) if registry.is_built_in(self.kind) else fields

    def go_on_from(self, before: "ProblemFile", problem: Problem) -> None:
        """Make sure that the individuals of the world ``before`` can live in this one, whose problem is ``problem``.

        Raises:
            BadInput: if they are coded otherwise.
        """
        self.keep_coding(before.problem().coding, problem.coding)

    def keep_coding(self, old: Coding, new: Coding) -> None:
        """The same, when both codings are known.

        Raises:
            BadInput: if they differ.
        """
        pairs: list[tuple[Any, Any]] = list(zip(old.alphabet, new.alphabet, strict=True))
        alike = type(old) is type(new) and old.genome_bytes == new.genome_bytes
        if not (alike and all(np.array_equal(*pair) for pair in pairs)):
            raise BadInput(
                f"{self.name}: the update would change how individuals are coded; submit another job instead"
            )

    def problem(self, *, checked: bool = False) -> Problem:
        """The problem itself, for the recipe and deme of the run.

        If it was ``checked`` by another process, it need not do again what costs time.

        Raises:
            BadInput: names this file and the field that is wrong.
        """
        try:
            model = self.find_model()
        except BadInput as error:
            raise BadInput(f"{self.name}: {error}") from error.__cause__  # what a user's module raised, if it did
        try:
            fields, context = json.dumps(self.fields | self.attempt_fields), CHECKED if checked else None
            problem = model.model_validate_json(fields, strict=True, context=context)
        except ValidationError as error:
            raise first_line(error, model, self.name) from None
        except Exception as error:  # from a user's class, which may be abstract or raise as it likes
            raise BadInput(f"{self.name}: kind: cannot make a {self.kind!r}: {_said(error)}") from error
        return self._with_recipe(problem)

    def refuse_unreachable(self) -> None:
        """Refuse a problem that surely has no solution as fit as it asks for; a run with a target of its own may try.

        A user's own problem is not asked.

        Raises:
            BadInput: names this file and the field.
        """
        if self.run.target is not None or not registry.is_built_in(self.kind):
            return
        if self.find_model().unreachable is Problem.unreachable:
            return  # to make the problem would be in vain, and may cost much
        why = self.problem(checked=True).unreachable
        if why is not None:
            raise BadInput(f"{self.name}: {why}")

    def find_model(self) -> type[Problem]:
        """The problem's class; this imports a user's module.

        Raises:
            BadInput: if there is no such kind, module or class.
        """
        return registry.find(self.kind, self.folder)

    def _with_recipe(self, problem: Problem) -> Problem:
        try:
            ready = problem.for_recipe(self.run.recipe, self.run.deme)
            _ = ready.coding.genome_bytes
            ready.coding.check(self.run.breeding(ready))
        except Exception as error:
            why = None if type(error) in _FOR_PEOPLE else error  # else a user's class is wrong, and they look for where
            raise BadInput(f"{self.name}: {_said(error)}") from why
        return ready

    def to_json(self) -> str:
        """For a message to another process."""
        values = [self.name, self.fields, self.run.model_dump(exclude_unset=True), str(self.folder)]
        of_attempt = [self.attempt, self.attempt_fields] if self.attempt or self.attempt_fields else []
        return json.dumps(values + of_attempt)

    @staticmethod
    def from_json(text: str) -> "ProblemFile":
        """The inverse of `to_json`.

        Raises:
            BadInput: if the text is something else.
        """
        try:
            name, fields, run, folder, *attempt = json.loads(text)
            number, changed = attempt or (0, {})
            right = isinstance(name, str) and isinstance(fields, dict) and isinstance(fields.get("kind"), str)
            right = right and type(number) is int and number >= 0 and isinstance(changed, dict)
            if not (right and isinstance(run, dict) and isinstance(folder, str)):
                raise TypeError
        except (ValueError, TypeError, RecursionError):
            raise BadInput(f"expected a problem file as JSON, found {shorten(text)}") from None
        return ProblemFile(name, fields, _run(run, name), Path(folder), number, changed)


def load(path: str | Path) -> ProblemFile:
    """Read a problem file and check it, but for a user's own problem, whose module is not imported here.

    Raises:
        BadInput: one line that names the file and field, what was expected and what was found.
    """
    path = Path(path)
    loaded = parse(_text(path), str(path), path.resolve().parent)
    if registry.is_built_in(loaded.kind):
        try:
            kind = registry.find(loaded.kind)
            loaded = replace(loaded, fields=kind.work_out(kind.gather(loaded.fields, loaded.folder)))
        except BadInput as error:
            raise BadInput(f"{path}: {error}") from None
        loaded.problem()
    elif ":" not in loaded.kind:
        loaded.problem()  # says which kinds there are
    return loaded


def load_patch(path: str | Path) -> dict[str, Any]:
    """Read the keys that an update gives a problem; see `filled_in`.

    Raises:
        BadInput: one line that names the file.
    """
    path = Path(path)
    patch = _plain(_text(path, "patch of a problem file"), str(path))
    if not patch:
        raise BadInput(f"{path}: expected keys of a problem file, found nothing")
    return patch


def filled_in(patch: dict[str, Any], world: ProblemFile, path: str | Path) -> dict[str, Any]:
    """The patch in the file ``path`` of a problem: its angles in radians, and what other files hold for their names.

    Args:
        patch: see `load_patch`.
        world: the problem before; its file's unit of angles is the patch's too, unless that says another.
        path: of the patch.

    Raises:
        BadInput: names the patch, the field, and the file that cannot be read.
    """
    if not registry.is_built_in(world.kind):
        return patch
    kind = registry.find(world.kind)
    try:
        return kind.gather(kind.read_angles(patch, world.fields), Path(path).resolve().parent)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None


def parse(text: str, name: str, folder: Path) -> ProblemFile:
    """A problem file's text; see `load`."""
    plain = _plain(text, name)
    run = plain.pop("run", {})
    if not isinstance(run, dict):
        raise BadInput(f"{name}: run: expected a table [run], found {shorten(run)}")
    if not isinstance(plain.get("kind"), str):
        found = shorten(plain["kind"]) if "kind" in plain else "nothing"
        raise BadInput(f'{name}: kind: expected a kind of problem such as "arm-ik", found {found}')
    if "unit" in plain and registry.is_built_in(plain["kind"]):
        try:
            plain = registry.find(plain["kind"]).read_angles(plain)
        except BadInput as error:
            raise BadInput(f"{name}: {error}") from error
    return ProblemFile(name, plain, _run(run, name), folder)


def _text(path: Path, what: str = "problem file") -> str:
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(f"{path}: expected a {what}, found no such file") from None
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: expected TOML in UTF-8, found {error}") from None
    except OSError as error:
        raise BadInput(f"{path}: expected a readable {what}, found {error.strerror}") from None


def _plain(text: str, name: str) -> dict[str, Any]:
    """What TOML says, in plain values."""
    try:
        plain: dict[str, Any] = json.loads(json.dumps(tomllib.loads(text), default=str))
    except (ValueError, RecursionError) as error:  # also for numbers too long, or tables too deep, to read at all
        raise BadInput(f"{name}: expected TOML, found {error}") from None
    return plain


def _said(error: Exception) -> str:
    """What ``error`` says; its type too, unless it is of those whose message is meant for people."""
    return str(error) if type(error) in _FOR_PEOPLE else f"{type(error).__name__}: {error}"


def _run(settings: dict[str, Any], name: str, given: frozenset[str] = frozenset()) -> Run:
    """The settings; a complaint names the file, but not for what was ``given`` beside it."""
    try:
        return Run.model_validate_json(json.dumps(with_topology(settings), default=str), strict=True)
    except ValidationError as error:
        location = error.errors()[0]["loc"]
        where = "options" if location and location[0] in given else f"{name}: run"
        raise first_line(error, Run, where) from None
    except ValueError as error:
        raise BadInput(f"{name}: run: {error}") from None
