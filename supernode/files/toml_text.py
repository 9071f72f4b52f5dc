"""Write problem files as TOML text: the standard library reads TOML but does not write it."""

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")


def as_toml(fields: Mapping[str, Any], run: Mapping[str, Any]) -> str:
    """Return a problem file with these fields and this ``[run]`` table.

    Values of None are left out: TOML cannot express them, and a missing key means the same.
    """
    return "\n".join([*_lines(fields), "", "[run]", *_lines(run), ""])


def as_tables(fields: Mapping[str, Any]) -> str:
    """Return a problem file for people to edit: plain values first, then a table ``[name]`` for each table or element.

    Values of None are left out.
    """
    plain, tables = {}, []
    for name, value in fields.items():
        if isinstance(value, dict):
            tables += ["", f"[{_key(name)}]", *_lines(value)]
        elif isinstance(value, list) and value and all(isinstance(each, dict) for each in value):
            tables += [line for each in value for line in ("", f"[[{_key(name)}]]", *_lines(each))]
        else:
            plain[name] = value
    return "\n".join([*_lines(plain), *tables, ""])


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(name)} = {_long(value)}" for name, value in table.items() if value is not None]


def _long(value: Any) -> str:
    """Return a value as TOML; an array of tables or arrays gets a line for each element."""
    if isinstance(value, list) and value and all(isinstance(each, dict | list) for each in value):
        return "[\n" + "".join(f"    {_short(each)},\n" for each in value) + "]"
    return _short(value)


def _short(value: Any) -> str:
    if isinstance(value, dict):
        pairs = [f"{_key(name)} = {_short(each)}" for name, each in value.items() if each is not None]
        return f"{{ {', '.join(pairs)} }}" if pairs else "{}"
    if isinstance(value, list):
        return f"[{', '.join(map(_short, value))}]"
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _key(name: str) -> str:
    return name if _BARE.fullmatch(name) else _short(name)
