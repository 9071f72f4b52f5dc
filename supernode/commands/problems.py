"""List the kinds of problem, or the fields of one with their units and defaults."""

import argparse
import json
from collections.abc import Iterator
from typing import Any

from supernode import exits

EXAMPLE = "supernode problems arm-ik"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the kind."""
    parser.add_argument("kind", metavar="KIND", nargs="?", help="show this kind in detail")
    parser.add_argument("--json", action="store_true", help="print the kinds, or the kind's JSON Schema, as JSON")


def run(options: argparse.Namespace) -> int:
    """Print the kinds, or the fields of one."""
    from problems.registry import find_registered, registered

    if options.kind is None:
        abouts = {kind: find_registered(kind).about for kind in registered()}
        print(json.dumps(abouts) if options.json else "\n".join(f"{kind:14} {about}" for kind, about in abouts.items()))
        return exits.OK
    model = find_registered(options.kind)
    schema = model.model_json_schema()
    if options.json:
        print(json.dumps(schema))
        return exits.OK
    print(f"{options.kind}: {model.about}\n")
    rows = list(_fields(schema, schema, ""))
    widths = [max(len(row[column]) for row in rows) for column in range(3)]
    for row in rows:
        cells = [text.ljust(width) for text, width in zip(row, widths, strict=False)]
        print("  " + "  ".join([*cells, row[3]]))
    return exits.OK


def _fields(schema: dict[str, Any], whole: dict[str, Any], prefix: str) -> Iterator[tuple[str, str, str, str]]:
    """Yield name, type with unit, default and description of each field of a file; a table's fields follow its name."""
    required = schema.get("required", ())
    for name, field in schema.get("properties", {}).items():
        if field.get("derived"):
            continue
        unit = f" ({field['unit']})" if field.get("unit") else ""
        yield prefix + name, _type(field) + unit, _default(name in required, field), field.get("description", "")
        for table, label in _tables(field, whole):
            yield from _fields(table, whole, f"{prefix}{name}{label}.")


def _tables(field: dict[str, Any], whole: dict[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Yield each table that a field may hold, with its shape: itself, one of several, or the elements of its array."""
    if "$ref" in field:
        table = whole["$defs"][field["$ref"].rsplit("/", 1)[1]]
        shape = table.get("properties", {}).get("shape", {}).get("const")
        yield table, f"[{shape}]" if shape else ""
    for choice in [*field.get("anyOf", ()), *field.get("oneOf", ()), *field.get("allOf", ())]:
        yield from _tables(choice, whole)
    if isinstance(field.get("items"), dict):
        yield from _tables(field["items"], whole)


def _type(field: dict[str, Any]) -> str:
    if "const" in field:
        return json.dumps(field["const"])
    if "enum" in field:
        return " | ".join(json.dumps(value) for value in field["enum"])
    if "$ref" in field:
        return "table"
    choices = [*field.get("anyOf", ()), *field.get("oneOf", ())]
    if choices:
        return " | ".join(dict.fromkeys(_type(choice) for choice in choices if choice.get("type") != "null"))
    if field.get("type") == "array":
        return _array(field)
    return str(field.get("type", "any"))


def _array(field: dict[str, Any]) -> str:
    if "prefixItems" in field:
        return "[" + ", ".join(_type(item) for item in field["prefixItems"]) + "]"
    return f"array of {_type(field.get('items', {}))}"


def _default(required: bool, field: dict[str, Any]) -> str:
    if required:
        return "required"
    default = field.get("default")
    return "optional" if default is None else f"= {json.dumps(default)}"
