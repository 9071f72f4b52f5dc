"""What is said of input that cannot be used, and of a problem that breaks while it runs."""

import difflib
import json
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel, ValidationError

_LONGEST_FOUND = 80


class BadInput(ValueError):  # noqa: N818 - it is the user's input that is bad, and people read the name
    """Input that cannot be used; the message names the file and field, what was expected and what was found."""


class EvaluationFailed(RuntimeError):  # noqa: N818
    """A problem's evaluation raised, or returned something that is no fitness."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A suggestion such as ``"; did you mean 'arm-ik'?"``, or nothing."""
    close = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f"; did you mean {close[0]!r}?" if close else ""


def first_line(error: ValidationError, model: type[BaseModel], where: str) -> BadInput:
    """The first complaint of a failed validation as one line that begins with ``where`` (a file, or an option)."""
    errors = error.errors(include_url=False)
    complaint = errors[0]
    field = _field(complaint["loc"])
    if complaint["type"] == "extra_forbidden":
        text = f"unknown field, expected {_siblings(model, complaint['loc'])}"
    elif complaint["type"] == "missing":
        text = "expected this field, found nothing"
    else:
        message = str(complaint["msg"]).removeprefix("Value error, ")
        message = message.replace("Input should be", "expected").replace("Input should", "expected to")
        found = "" if "found" in message else f", found {shorten(complaint.get('input'))}"
        text = message[0].lower() + message[1:] + found
    more = f" (and {len(errors) - 1} more)" if len(errors) > 1 else ""
    return BadInput(f"{where}: {field + ': ' if field else ''}{text}{more}")


def shorten(value: Any) -> str:
    """``value`` as a message shows it."""
    text = json.dumps(value, default=str)
    return text if len(text) <= _LONGEST_FOUND else text[: _LONGEST_FOUND - 1] + "…"


def _field(location: tuple[int | str, ...]) -> str:
    text = ""
    for part in location:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


def _siblings(model: type[BaseModel], location: tuple[int | str, ...]) -> str:
    known = list(model.model_fields)
    if len(location) > 1:
        return "one of those that this table has (see `supernode problems`)"
    return "one of " + ", ".join(known) + did_you_mean(str(location[0]), known)
