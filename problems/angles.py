"""Angles of problem files, in radians or in degrees. Degrees are converted once, where the file is read.

Everything after reading (validation, nodes, results) works in radians only.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, field_validator

from problems.errors import BadInput, tables_in
from problems.problem import Problem
from problems.tables import derived, quantity

MOST = 4.0 * np.pi
"""The largest absolute value of an angle in a problem file, rad. A larger number was probably meant in degrees."""

_ROUNDING = 1e-9  # rad
_PER_DEGREE = np.pi / 180.0  # rad
_MOST_DEGREES = 720.0  # `MOST`, in degrees
Fields = dict[str, Any]


def plausible(angle: float) -> float:
    """Return the angle, rad, unchanged.

    Raises:
        ValueError: if its absolute value exceeds two turns.
    """
    if abs(angle) > MOST + _ROUNDING:
        raise ValueError(
            f"expected an angle from -4π to 4π rad, found {angle:g}; did you mean degrees? "
            f'{angle:g}° is {angle * _PER_DEGREE:.4g} rad; say unit = "deg" in the file'
        )
    return angle


Angle = Annotated[float, AfterValidator(plausible)]
"""An angle of a problem file, rad."""


class WithAngles(Problem):
    """A problem whose file may give its angles in degrees."""

    unit: Literal["rad", "deg"] = quantity(
        "",
        'of all angles in the file: with "deg" they are in degrees, and speeds in degrees per second, whatever unit is '
        "listed here; results are always in radians",
        default="rad",
    )
    written_in: Literal["deg"] | None = derived(
        "the unit of the file that was read, which files of updates share", default=None
    )

    @field_validator("unit")
    @classmethod
    def _is_read(cls, unit: str) -> str:
        if unit == "deg":
            # `read_angles` removes the field. A "deg" that arrives here was not converted: the problem was made in
            # Python, or is of a user's own kind.
            raise ValueError('expected "rad", as only problem files may use degrees, found "deg"')
        return unit

    @classmethod
    def read_angles(cls, fields: Fields, world: Mapping[str, Any] | None = None) -> Fields:
        """Return the fields in radians if the file, or the file of an update, is in degrees; see `Problem.read_angles`.

        The converted fields of a problem file record the unit in ``written_in``, for later updates.
        """
        world = world or {}
        unit = fields.get("unit", world.get("written_in"))
        if unit == "deg":
            radians = {name: value for name, value in fields.items() if name != "unit"}
            radians = cls.from_degrees(radians, {**world, **fields})
            return radians if world else radians | {"written_in": "deg"}
        return fields

    @classmethod
    def from_degrees(cls, fields: Fields, problem: Mapping[str, Any]) -> Fields:
        """Return the fields with all angles converted from degrees to radians.

        An angle is any number in a field whose unit starts with ``rad``, which includes rad/s and rad/s².

        Args:
            fields: plain values, not yet validated.
            problem: all fields of the problem; ``fields`` may be only some of them.

        Raises:
            BadInput: if an angle exceeds two turns; the message names the field.
        """
        return _table([cls], fields, "")


def _table(models: list[type[BaseModel]], values: Fields, at: str) -> Fields:
    """Return a table in radians. It is an instance of one of ``models``, but not yet known to be of which."""
    known: dict[str, tuple[type[BaseModel], str]] = {}
    for model in models:
        for name, field in model.model_fields.items():
            known.setdefault(field.alias or name, (model, name))
    read = {}
    for name, value in values.items():
        read[name] = _field(*known[name], value, at + name) if name in known else value
    return read


def _field(model: type[BaseModel], name: str, value: Any, at: str) -> Any:
    """Return the value of one field in radians; ``at`` is its place in the file, for messages."""
    extra = model.model_fields[name].json_schema_extra
    # A field with several units, such as "m, m, m, rad", is a list with one unit for each element.
    units = str(extra.get("unit", "")).split(", ") if isinstance(extra, dict) else [""]
    if len(units) > 1 and isinstance(value, list):
        return [each if number >= len(units) else in_unit(units[number], each, f"{at}[{number}]")
                for number, each in enumerate(value)]  # fmt: skip
    if len(units) == 1 and units[0].startswith("rad"):
        return in_unit(units[0], value, at)
    return _tables(tables_in(model, name), value, at)


def _tables(models: list[type[BaseModel]], value: Any, at: str) -> Any:
    """Return a value in which every table, at any depth of lists, is converted; other values stay as they are."""
    if isinstance(value, list):
        return [_tables(models, each, f"{at}[{number}]") for number, each in enumerate(value)]
    return _table(models, value, at + ".") if isinstance(value, dict) else value


def in_unit(unit: str, value: Any, at: str) -> Any:
    """Return a number, or nested lists of numbers, in radians if ``unit`` is a unit of angles.

    Args:
        unit: the field's unit.
        value: the plain value; anything that is no number is returned unchanged, for validation to refuse.
        at: the value's place in the file, for messages.

    Raises:
        BadInput: if an angle exceeds two turns; the message names its place.
    """
    if isinstance(value, list):
        return [in_unit(unit, each, f"{at}[{number}]") for number, each in enumerate(value)]
    if not unit.startswith("rad") or not isinstance(value, float | int) or isinstance(value, bool):
        return value
    if unit == "rad" and abs(value) > _MOST_DEGREES:
        raise BadInput(f"{at}: expected an angle from -720 to 720, in degrees, found {value:g}")
    return value * _PER_DEGREE
