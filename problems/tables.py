"""Tables of problem files, and what their fields are made of, for all models."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field
from pydantic.config import JsonDict
from pydantic.fields import FieldInfo

RecipeName = Literal["tuned", "paper"]


class Table(BaseModel):  # noqa: PLW1641 - pydantic hashes what is frozen, by its fields
    """A table of a problem file. Validation refuses unknown fields, wrong types, NaN and infinity."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    def __eq__(self, other: object) -> bool:
        """Compare the fields only: cached properties may hold arrays, whose ``==`` is not a single boolean."""
        if type(other) is not type(self):
            return NotImplemented
        return all(getattr(self, name) == getattr(other, name) for name in type(self).model_fields)


def quantity(unit: str, description: str, **options: Any) -> Any:
    """Return a pydantic field with a unit and a description, which `supernode problems KIND` shows."""
    return Field(description=description, json_schema_extra={"unit": unit}, **options)


def derived(description: str, **options: Any) -> Any:
    """Return a pydantic field that `Problem.derive_fields` or `Problem.gather` sets; files do not have it."""
    extra: JsonDict = {"unit": "", "derived": True}
    return Field(description=f"{description}; set by the program, not in a file", json_schema_extra=extra, **options)


def is_derived(field: FieldInfo) -> bool:
    """Return whether a field was made by `derived`."""
    extra = field.json_schema_extra
    return isinstance(extra, dict) and bool(extra.get("derived"))
