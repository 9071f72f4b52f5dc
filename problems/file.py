"""Read problem files: from TOML to a validated problem and its run settings."""

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
from problems.plain_values import refuse_nested
from problems.problem import CHECKED, Problem
from problems.run import Run, with_topology

_COMPLETE = (BadInput, ValueError)
"""Exceptions whose messages are complete; for any other one the type is worth showing, too."""


@dataclass(frozen=True)
class ProblemFile:
    """A problem as plain values, and the settings of its run.

    This is what travels between processes: every process makes its own `Problem` of it, see `problem`.

    Attributes:
        name: the file's name, for messages.
        fields: the problem's own fields as plain values. The fields of a user's own problem are validated only in
            processes that may import its module.
        run: the settings of the ``[run]`` table.
        folder: the folder in which a user's module is looked up first.
        attempt: the number of restarts since the problem was last changed.
        attempt_fields: the fields that these restarts have changed, see `Problem.next_attempt`. They are kept apart,
            since they do not change which problem it is: `sha256` leaves them out.
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
        """A digest of the problem's fields, independent of their order, the run's settings and the attempt."""
        return digest(self.fields)

    def with_run(self, **settings: Any) -> "ProblemFile":
        """Return the same problem with some settings of the run replaced.

        Args:
            settings: new values by name; None keeps the old value. ``torus`` is shorthand for a ``topology``.

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
        """Return this problem after an update.

        Individuals survive an update, so it must not change how they are coded. A user's own problem is not validated
        here. No file is read: `filled_in` has replaced the names of files by their contents already.

        Args:
            fields: the problem's fields to replace.
            run: the settings of the run to replace.

        Raises:
            BadInput: if a field is unknown or wrong, or the coding would change; the message blames the update, not
                this file.
        """
        with blaming_the_update(bool(fields)):
            return self._changed(fields, run)

    def _changed(self, fields: dict[str, Any], run: dict[str, Any]) -> "ProblemFile":
        if fields.get("kind", self.kind) != self.kind:
            raise BadInput(f"{self.name}: kind: expected {self.kind!r} as before, found {shorten(fields['kind'])}")
        if "run" in fields:
            raise BadInput(f"{self.name}: run: expected no [run] in an update, it is for the problem alone")
        # The individuals are coded as the last attempt has it, so its changes stay, unless the update sets them.
        kept = {name: value for name, value in self.attempt_fields.items() if name not in fields}
        attempt = 0 if fields else self.attempt  # a changed problem has all of its attempts before it
        other = replace(self, fields=self._worked_out(self.fields | fields), attempt=attempt).with_run(**run)
        other = other._with_attempt_fields(kept)
        if registry.is_built_in(self.kind):
            other.go_on_from(self, other.problem())
            other.refuse_unreachable()
        return other

    def next_attempt(self, fields: dict[str, Any]) -> "ProblemFile":
        """Return the same problem for the next attempt.

        Args:
            fields: the fields that this attempt changes, in addition to those that earlier attempts have changed.

        Raises:
            BadInput: if a built-in problem refuses these fields. A user's own problem is not validated here.
        """
        for name in ("kind", "run"):  # `next_attempt` may be a user's code
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
        """Return the same problem after all restarts recorded in a result's directives."""
        file = self
        for directive in directives:
            if directive["do"] == "retry":
                file = file.next_attempt(directive["fields"])
        return file

    def _with_attempt_fields(self, fields: dict[str, Any]) -> "ProblemFile":
        """Return the same problem with ``fields``, and all derived fields that depend on them, as attempt fields."""
        if not fields:
            return replace(self, attempt_fields={})
        whole = self._worked_out(self.fields | fields)
        changed = {name: value for name, value in whole.items() if self.fields.get(name, ...) != value}
        return replace(self, attempt_fields=changed)

    def _worked_out(self, fields: dict[str, Any]) -> dict[str, Any]:
        """Return the fields with derived ones, see `Problem.derive_fields`; a user's own kind has none."""
        return registry.find(self.kind).derive_fields(fields) if registry.is_built_in(self.kind) else fields

    def go_on_from(self, before: "ProblemFile", problem: Problem) -> None:
        """Refuse to continue with the individuals of another problem if this one codes them differently.

        Args:
            before: the problem before the update.
            problem: this file's problem.

        Raises:
            BadInput: if the codings differ.
        """
        self.keep_coding(before.problem().coding, problem.coding)

    def keep_coding(self, old: Coding, new: Coding) -> None:
        """Refuse an update that changes the coding from ``old`` to ``new``.

        Raises:
            BadInput: if the codings differ in type, genome size or alphabet.
        """
        pairs: list[tuple[Any, Any]] = list(zip(old.alphabet, new.alphabet, strict=True))
        alike = type(old) is type(new) and old.genome_bytes == new.genome_bytes
        if not (alike and all(np.array_equal(*pair) for pair in pairs)):
            raise BadInput(
                f"{self.name}: the update would change how individuals are coded; submit another job instead"
            )

    def problem(self, *, checked: bool = False) -> Problem:
        """Make the problem, for the recipe and deme size of the run. For a user's own kind, this imports its module.

        Args:
            checked: True if another process has validated it already; costly validators may then skip their work.

        Raises:
            BadInput: if a field is wrong; the message names this file and the field.
        """
        try:
            model = self.find_model()
        except BadInput as error:
            raise BadInput(f"{self.name}: {error}") from error.__cause__  # the exception of a user's module, if any
        try:
            fields, context = json.dumps(self.fields | self.attempt_fields), CHECKED if checked else None
            problem = model.model_validate_json(fields, strict=True, context=context)
        except ValidationError as error:
            raise first_line(error, model, self.name) from None
        except Exception as error:  # a user's class may be abstract, or its validators may raise anything
            raise BadInput(f"{self.name}: kind: cannot make a {self.kind!r}: {_message_of(error)}") from error
        return self._with_recipe(problem)

    def refuse_unreachable(self) -> None:
        """Refuse a built-in problem that certainly has no solution as good as it asks for, see `Problem.unreachable`.

        A run that sets its own target is not refused: it may look for the best that is possible.

        Raises:
            BadInput: names this file and the field.
        """
        if self.run.target is not None or not registry.is_built_in(self.kind):
            return
        if self.find_model().unreachable is Problem.unreachable:
            return  # the kind never objects, so do not make the problem, which may be costly
        why = self.problem(checked=True).unreachable
        if why is not None:
            raise BadInput(f"{self.name}: {why}")

    def find_model(self) -> type[Problem]:
        """Return the problem's class. For a user's own kind, this imports its module.

        Raises:
            BadInput: if there is no such kind, module or class.
        """
        return registry.find(self.kind, self.folder)

    def _with_recipe(self, problem: Problem) -> Problem:
        """Return the problem for the run's recipe, once its coding and the recipe are known to fit."""
        try:
            ready = problem.for_recipe(self.run.recipe, self.run.deme)
            _ = ready.coding.genome_bytes  # a user's coding that fails shall fail here, not later in every node
            ready.coding.check(self.run.breeding(ready))
        except Exception as error:
            why = None if type(error) in _COMPLETE else error  # a fault of a user's class: keep its traceback
            raise BadInput(f"{self.name}: {_message_of(error)}") from why
        return ready

    def to_json(self) -> str:
        """Return the file as JSON, for a message to another process."""
        # Unset settings are left out: the other process then knows, too, which ones the user has chosen.
        values = [self.name, self.fields, self.run.model_dump(exclude_unset=True), str(self.folder)]
        of_attempt = [self.attempt, self.attempt_fields] if self.attempt or self.attempt_fields else []
        return json.dumps(values + of_attempt)

    @staticmethod
    def from_json(text: str) -> "ProblemFile":
        """Return the file that `to_json` has encoded.

        Raises:
            BadInput: if ``text`` is not the output of `to_json`.
        """
        try:
            found = json.loads(text)
            refuse_nested(found)
            name, fields, run, folder, *attempt = found
            number, changed = attempt or (0, {})
            right = isinstance(name, str) and isinstance(fields, dict) and isinstance(fields.get("kind"), str)
            right = right and type(number) is int and number >= 0 and isinstance(changed, dict)
            if not (right and isinstance(run, dict) and isinstance(folder, str)):
                raise TypeError
        except (ValueError, TypeError, RecursionError):
            raise BadInput(f"expected a problem file as JSON, found {shorten(text)}") from None
        return ProblemFile(name, fields, _run(run, name), Path(folder), number, changed)


def load(path: str | Path) -> ProblemFile:
    """Read and validate a problem file.

    The fields of a user's own problem are not validated, since its module is not imported here.

    Raises:
        BadInput: if the file cannot be used; one line names the file, the field, what was expected and what was found.
    """
    path = Path(path)
    loaded = parse(_text(path), str(path), path.resolve().parent)
    if registry.is_built_in(loaded.kind):
        try:
            kind = registry.find(loaded.kind)
            loaded = replace(loaded, fields=kind.derive_fields(kind.gather(loaded.fields, loaded.folder)))
        except BadInput as error:
            raise BadInput(f"{path}: {error}") from None
        loaded.problem()
    elif not registry.is_users_own(loaded.kind):
        loaded.problem()  # no such kind: this raises an error that lists the known ones
    return loaded


def load_patch(path: str | Path) -> dict[str, Any]:
    """Read the file of an update: the fields of a problem that it changes, as written. See `filled_in`.

    Raises:
        BadInput: if the file cannot be read or is empty; one line that names it.
    """
    path = Path(path)
    patch = _plain(_text(path, "patch of a problem file"), str(path))
    if not patch:
        raise BadInput(f"{path}: expected keys of a problem file, found nothing")
    return patch


def filled_in(patch: dict[str, Any], world: ProblemFile, path: str | Path) -> dict[str, Any]:
    """Return an update's fields with angles in radians and names of other files replaced by their contents.

    Args:
        patch: the fields that `load_patch` has read.
        world: the problem before the update. Its file's unit of angles holds for the patch, unless the patch sets one.
        path: the file of the patch.

    Raises:
        BadInput: if an angle is out of range or a file cannot be read; the message names the patch, the field and the
            file.
    """
    if not registry.is_built_in(world.kind):
        return patch
    kind = registry.find(world.kind)
    try:
        return kind.gather(kind.read_angles(patch, world.fields), Path(path).resolve().parent)
    except BadInput as error:
        raise BadInput(f"{path}: {error}") from None


def parse(text: str, name: str, folder: Path) -> ProblemFile:
    """Parse the text of a problem file. Its problem is not yet validated, and other files are not read; see `load`.

    Args:
        text: TOML.
        name: the file's name, for messages.
        folder: the file's folder.

    Raises:
        BadInput: if the text is not TOML, or its kind, run settings or angles are wrong.
    """
    plain = _plain(text, name)
    run = plain.pop("run", {})
    if not isinstance(run, dict):
        raise BadInput(f"{name}: run: expected a table [run], found {shorten(run)}")
    if not isinstance(plain.get("kind"), str):
        found = shorten(plain["kind"]) if "kind" in plain else "nothing"
        raise BadInput(f'{name}: kind: expected a kind of problem such as "arm-ik", found {found}')
    # Without this field angles are radians already, and the kind need not be imported for them.
    if "unit" in plain and registry.is_built_in(plain["kind"]):
        try:
            plain = registry.find(plain["kind"]).read_angles(plain)
        except BadInput as error:
            raise BadInput(f"{name}: {error}") from error
    return ProblemFile(name, plain, _run(run, name), folder)


def _text(path: Path, what: str = "problem file") -> str:
    """Read a text file; errors call it ``what``."""
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError:
        raise BadInput(f"{path}: expected a {what}, found no such file") from None
    except UnicodeDecodeError as error:
        raise BadInput(f"{path}: expected TOML in UTF-8, found {error}") from None
    except OSError as error:
        raise BadInput(f"{path}: expected a readable {what}, found {error.strerror}") from None


def _plain(text: str, name: str) -> dict[str, Any]:
    """Parse TOML and return plain JSON values; dates become strings."""
    try:
        plain: dict[str, Any] = json.loads(json.dumps(tomllib.loads(text), default=str))
        refuse_nested(plain)
    except (ValueError, RecursionError) as error:  # raised, too, for numbers too long and tables nested too deep
        raise BadInput(f"{name}: expected TOML, found {error}") from None
    return plain


def _message_of(error: Exception) -> str:
    """Return the message of ``error``, preceded by its type unless it is one of `_COMPLETE`."""
    return str(error) if type(error) in _COMPLETE else f"{type(error).__name__}: {error}"


def _run(settings: dict[str, Any], name: str, given: frozenset[str] = frozenset()) -> Run:
    """Validate the settings of a run.

    Args:
        settings: plain values by name.
        name: the problem file, which errors name.
        given: the settings that did not come from the file; errors about them say "options" instead.
    """
    try:
        return Run.model_validate_json(json.dumps(with_topology(settings), default=str), strict=True)
    except ValidationError as error:
        location = error.errors()[0]["loc"]
        where = "options" if location and location[0] in given else f"{name}: run"
        raise first_line(error, Run, where) from None
    except ValueError as error:
        raise BadInput(f"{name}: run: {error}") from None
