"""Formats of inputs: how to read one as plain values, and how to write such values again.

So one mutation of plain values serves all formats. Reading or writing may raise anything.
"""

import json
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree

import msgpack

from supernode.files.toml_text import as_tables


@dataclass(frozen=True)
class Form:
    """A format; ``read`` and ``write`` are None if only the bytes can be changed."""

    read: Callable[[bytes], Any] | None = None
    write: Callable[[Any], bytes] | None = None


def _from_toml(data: bytes) -> Any:
    return json.loads(json.dumps(tomllib.loads(data.decode()), default=str))


def _to_toml(value: Any) -> bytes:
    # JSON and TOML write these numbers in different ways.
    return as_tables(value).replace("-Infinity", "-inf").replace("Infinity", "inf").replace("NaN", "nan").encode()


def _from_xml(data: bytes) -> Any:
    return _plain(ElementTree.fromstring(data))


def _plain(element: ElementTree.Element) -> list[Any]:
    return [element.tag, dict(element.attrib), [_plain(each) for each in element]]


def _to_xml(value: Any) -> bytes:
    return ElementTree.tostring(_element(value))


def _element(value: Any) -> ElementTree.Element:
    tag, attributes, children = value
    element = ElementTree.Element(str(tag), {str(name): str(each) for name, each in attributes.items()})
    element.extend(map(_element, children))
    return element


def _from_yaml(data: bytes) -> Any:
    import yaml

    return json.loads(json.dumps(yaml.safe_load(data), default=str))


BYTES = Form()
MSGPACK = Form(lambda data: msgpack.unpackb(data, strict_map_key=False), msgpack.packb)
JSON = Form(json.loads, lambda value: json.dumps(value).encode())
TOML = Form(_from_toml, _to_toml)
XML = Form(_from_xml, _to_xml)
YAML = Form(_from_yaml, lambda value: json.dumps(value).encode())  # JSON is YAML, too
