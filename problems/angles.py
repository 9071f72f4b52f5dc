"""Angles of problem files: in radians, or in degrees if the file says so. Where a file is read, all become radians."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, field_validator

from problems.errors import BadInput, tables_in
from problems.problem import Problem, quantity

MOST = 4.0 * np.pi
"""No angle of a problem file is farther from 0, rad: what is, is most likely meant in degrees."""

_ROUNDING = 1e-9  # rad
_PER_DEGREE = np.pi / 180.0
_MOST_DEGREES = 720.0
Fields = dict[str, Any]


def plausible(angle: float) -> float:
    """An angle, rad, as it is.

    Raises:
        ValueError: if it is more than two turns.
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
        "told here; results are in radians all the same",
        default="rad",
    )
    written_in: Literal["deg"] | None = quantity(
        "",
        "the unit of the file that was read, and so of files of updates; not to be written",
        default=None,
    )

    @field_validator("unit")
    @classmethod
    def _is_read(cls, unit: str) -> str:
        if unit == "deg":
            raise ValueError('expected "rad", since degrees are only read in a file, found "deg"')
        return unit

    @classmethod
    def read_angles(cls, fields: Fields, world: Mapping[str, Any] | None = None) -> Fields:
        """See `Problem.read_angles`."""
        world = world or {}
        unit = fields.get("unit", world.get("written_in"))
        if unit == "deg":
            radians = {name: value for name, value in fields.items() if name != "unit"}
            radians = cls.from_degrees(radians, {**world, **fields})
            return radians if world else radians | {"written_in": "deg"}
        return fields

    @classmethod
    def from_degrees(cls, fields: Fields, problem: Mapping[str, Any]) -> Fields:
        """With all angles turned from degrees into radians: those in fields whose unit is rad, or rad/s and the like.

        Args:
            fields: plain values, not yet checked.
            problem: all fields of the problem; ``fields`` may be a few of them.

        Raises:
            BadInput: names an angle of more than two turns.
        """
        return _table([cls], fields, "")


def _table(models: list[type[BaseModel]], values: Fields, at: str) -> Fields:
    """A table in radians that is one of some ``models``."""
    known: dict[str, tuple[type[BaseModel], str]] = {}
    for model in models:
        for name, field in model.model_fields.items():
            known.setdefault(field.alias or name, (model, name))
    read = {}
    for name, value in values.items():
        read[name] = _field(*known[name], value, at + name) if name in known else value
    return read


def _field(model: type[BaseModel], name: str, value: Any, at: str) -> Any:
    extra = model.model_fields[name].json_schema_extra
    units = str(extra.get("unit", "")).split(", ") if isinstance(extra, dict) else [""]
    if len(units) > 1 and isinstance(value, list):
        return [each if number >= len(units) else in_unit(units[number], each, f"{at}[{number}]")
                for number, each in enumerate(value)]  # fmt: skip
    if len(units) == 1 and units[0].startswith("rad"):
        return in_unit(units[0], value, at)
    return _tables(tables_in(model, name), value, at)


def _tables(models: list[type[BaseModel]], value: Any, at: str) -> Any:
    """What holds tables, if it does."""
    if isinstance(value, list):
        return [_tables(models, each, f"{at}[{number}]") for number, each in enumerate(value)]
    return _table(models, value, at + ".") if isinstance(value, dict) else value


def in_unit(unit: str, value: Any, at: str) -> Any:
    """Numbers, in lists of lists if need be, of a field ``at`` some place in radians, if its unit is of angles.

    Raises:
        BadInput: names an angle of more than two turns.
    """
    if isinstance(value, list):
        return [in_unit(unit, each, f"{at}[{number}]") for number, each in enumerate(value)]
    if not unit.startswith("rad") or not isinstance(value, float | int) or isinstance(value, bool):
        return value
    if unit == "rad" and abs(value) > _MOST_DEGREES:
        raise BadInput(f"{at}: expected an angle from -720 to 720, in degrees, found {value:g}")
    return value * _PER_DEGREE
