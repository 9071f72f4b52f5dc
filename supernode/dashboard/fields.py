"""Read the fields that a form or a script sends, each with one clear error if it is wrong."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any
from urllib.parse import parse_qsl

from starlette.exceptions import HTTPException
from starlette.requests import Request

from problems import BadInput
from problems.errors import shorten
from wire import jobs as wire


async def fields_of(request: Request, most: int) -> dict[str, Any]:
    """Return the fields of a form or of a JSON object, of at most ``most`` bytes.

    Raises:
        BadInput: if it is neither.
        HTTPException: if it is of another kind, or too large.
    """
    kind = request.headers.get("content-type", "").partition(";")[0].strip()
    body = await _body(request, most)
    try:
        if kind == "application/x-www-form-urlencoded":
            return dict(parse_qsl(body.decode(), keep_blank_values=True, strict_parsing=True, max_num_fields=16))
        if kind != "application/json":
            raise HTTPException(415, "expected JSON or a form")
        given = json.loads(body)
    except (ValueError, RecursionError):
        raise BadInput("expected a JSON object or a form, found something else") from None
    if not isinstance(given, dict):
        raise BadInput("expected a JSON object, found something else")
    return given


async def _body(request: Request, most: int) -> bytes:
    body = bytearray()
    async for part in request.stream():
        body += part
        if len(body) > most:
            raise HTTPException(413, f"expected at most {most} bytes")
    return bytes(body)


def text_of(given: Mapping[str, Any], field: str, default: str, most: int | None = None) -> str:
    """Return a field's text, of at most ``most`` characters."""
    text = given.get(field, default)
    if not isinstance(text, str) or text != wire.encodable(text):
        raise BadInput(f"{field}: expected text, found {shorten(text)}")
    if most is not None and len(text) > most:
        raise BadInput(f"{field}: expected at most {most} characters, found {len(text)}")
    return text


def as_whole(given: Any, field: str, most: int) -> int:
    """Return a whole number; a form sends it as text, and so does a script that sends a form as JSON."""
    number = int(given) if isinstance(given, str) and re.fullmatch(r"\s*[+-]?[0-9]{1,20}\s*", given) else given
    if type(number) is not int or abs(number) > most:
        raise BadInput(f"{field}: expected a whole number, at most {most}, found {shorten(given)}")
    return number


def as_number(given: Any, field: str) -> float:
    """Return a finite number; a form sends it as text."""
    try:
        number = math.nan if isinstance(given, bool) else float(given)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise BadInput(f"{field}: expected a number, found {shorten(given)}")
    return number
