"""Errors about unusable input and failing problems, and the helpers that phrase their one-line messages."""

import contextlib
import difflib
import json
import re
from collections.abc import Iterable, Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic import BaseModel, ValidationError

from problems.tables import is_derived

_LONGEST_FOUND = 80
_TYPES = ("bool", "float", "int", "str")  # as pydantic names them where a field may be of several


class BadInput(ValueError):  # noqa: N818 - it is the user's input that is bad, and people read the name
    """Input that cannot be used.

    The message names the file and the field, what was expected and what was found. Line breaks are removed from it.
    """

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


class EvaluationFailed(RuntimeError):  # noqa: N818
    """A method of a problem raised, or returned something it must not; line breaks are removed from the message."""

    def __init__(self, message: str) -> None:
        super().__init__(one_line(message))


UPDATE_OF = "update of "
"""Prefix of a message about an update of a problem file, so that the file itself is not blamed."""


@contextlib.contextmanager
def blaming_the_update(is_one: bool = True) -> Iterator[None]:
    """Prefix a `BadInput` raised in this context with `UPDATE_OF`, if ``is_one``: if the input is an update."""
    try:
        yield
    except BadInput as error:
        if not is_one or str(error).startswith(UPDATE_OF):
            raise
        raise BadInput(f"{UPDATE_OF}{error}") from error.__cause__


def one_line(text: str) -> str:
    """Return ``text`` with its lines stripped and joined by spaces."""
    return " ".join(line.strip() for line in text.splitlines())


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """Return a suggestion such as ``"; did you mean 'arm-ik'?"``, or an empty string if no known word is close."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.55)
    return f"; did you mean {close[0]!r}?" if close else ""


def first_line(error: ValidationError, model: type[BaseModel], where: str) -> BadInput:
    """Return the most useful complaint of a failed validation as a `BadInput`.

    Args:
        error: the failed validation.
        model: the class that was validated, for its field names.
        where: the start of the message: a file, or an option.
    """
    by_field: dict[str, list[Any]] = {}  # for a field of a union type, pydantic complains once for each member type
    for complaint in error.errors(include_url=False):
        by_field.setdefault(_field(complaint), []).append(complaint)
    # Prefer an unknown field to a missing one: it may be the missing field, misspelt.
    unknown = (item for item in by_field.items() if item[1][0]["type"] == "extra_forbidden")
    field, complaints = next(unknown, None) or next(iter(by_field.items()))
    first = complaints[0]
    if first["type"] == "extra_forbidden":
        text = f"unknown field, expected {_siblings(model, first['loc'])}"
    elif first["type"] == "missing" and isinstance(first["loc"][-1], int):
        field, text = _field(first | {"loc": first["loc"][:-1]}), _too_few(complaints, error)
    elif first["type"] in ("missing", "union_tag_not_found"):
        text = "expected this field, found nothing"
    elif first["type"] == "union_tag_invalid":
        text = f"expected one of {first['ctx']['expected_tags']}, found {shorten(first['ctx']['tag'])}"
    else:
        expected = " or ".join(dict.fromkeys(_expectation(complaint) for complaint in complaints))
        text = re.sub(" or expected ", " or ", expected)
        if "found" not in text:
            text += f", found {shorten(first.get('input'))}"
    more = f" (and {len(by_field) - 1} more)" if len(by_field) > 1 else ""
    return BadInput(f"{where}: {field + ': ' if field else ''}{text}{more}")


def _too_few(complaints: list[Any], error: ValidationError) -> str:
    """Return the complaint about an array that is too short."""
    # Pydantic complains once for each missing element; the input of each complaint is the whole array.
    found, place = complaints[0]["input"], complaints[0]["loc"][:-1]
    missing = [each for each in error.errors() if each["type"] == "missing" and each["loc"][:-1] == place]
    return f"expected {len(found) + len(missing)} values, found {len(found)}: {shorten(found)}"


def shorten(value: Any) -> str:
    """Return ``value`` as JSON for a message, cut to a readable length.

    YAML can hold a value many times at little cost, or within itself, and keys that JSON lacks. So only as much is
    encoded as is shown.
    """
    text = ""
    try:
        for part in json.JSONEncoder(default=str).iterencode(value):
            text += part
            if len(text) > _LONGEST_FOUND:
                break
    except (TypeError, ValueError):
        text += "…"
    return text if len(text) <= _LONGEST_FOUND else text[: _LONGEST_FOUND - 1] + "…"


def _expectation(complaint: Any) -> str:
    """Return pydantic's message in the form "expected …", which all messages here share."""
    message = str(complaint["msg"]).removeprefix("Value error, ")
    message = re.sub(r"^\w+ should have (.*?)( after validation, not .*)?$", r"expected \1", message)
    message = re.sub(r"^\w+ should be", "expected", message)
    message = re.sub(r"^\w+ should", "expected to", message)
    return message[:1].lower() + message[1:]


def _field(complaint: Any) -> str:
    """Return the field that a complaint is about, such as ``obstacles[2].radius``."""
    location = list(complaint["loc"])
    last = len(location) - 1
    named = complaint["type"] in ("missing", "extra_forbidden")
    text = ""
    for place, part in enumerate(location):
        if isinstance(part, int):
            text += f"[{part}]"
        elif place == 0 or (named and place == last) or (part.isidentifier() and part not in _TYPES):
            text += f".{part}" if text else part
        # Any other part is no field: pydantic adds the name of a member type of a union, such as "constrained-float".
    if complaint["type"].startswith("union_tag"):
        text += "." + complaint["ctx"]["discriminator"].strip("'")
    return text


def _siblings(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    """Return the known fields beside an unknown one at ``location``, and a suggestion if one of them is close."""
    tables = [model]
    for part in location[:-1]:  # a field, a list index, or the tag of a discriminated union
        inner = [each for table in tables if part in table.model_fields for each in tables_in(table, str(part))]
        chosen = [table for table in tables if _is_tagged(table, part)]
        tables = inner or chosen or tables
    fields = [each for table in tables for each in table.model_fields.items() if not is_derived(each[1])]
    known = list(dict.fromkeys(field.alias or name for name, field in fields))
    known += [name for table in tables for name in getattr(table, "shorthands", ())]
    return "one of " + ", ".join(known) + did_you_mean(str(location[-1]), known)


def tables_in(table: type[BaseModel], field: str) -> list[type[BaseModel]]:
    """Return the table classes that a field may hold, whether directly, in a union, or as elements of a list."""
    found, left = [], [table.model_fields[field].annotation]
    while left:
        annotation = left.pop(0)
        if isinstance(annotation, type) and get_origin(annotation) is None and issubclass(annotation, BaseModel):
            found.append(annotation)
        left += [argument for argument in get_args(annotation) if get_origin(annotation) is not Literal]
    return found


def _is_tagged(table: type[BaseModel], tag: int | str) -> bool:
    """Return whether ``table`` is the member of a discriminated union that has this tag."""
    return any(tag in get_args(field.annotation) for field in table.model_fields.values())
