"""Any value of ours as JSON, for what is recorded. Takes values; gives JSON. Pure."""

from __future__ import annotations

import dataclasses
import enum
import hashlib
from collections.abc import Mapping
from typing import Any

import msgspec

from srprov.secret import MASK, Hidden


def fields_of(value: object) -> tuple[str, ...]:
    """Return the names of the fields of a Struct or a dataclass; of anything else, none."""
    if isinstance(value, msgspec.Struct):
        return value.__struct_fields__
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return tuple(field.name for field in dataclasses.fields(value))
    return ()


def plain(value: object) -> Any:  # noqa: ANN401 - JSON is any
    """Return any value as JSON: values by their fields, bytes by length and hash, hidden ones as `***`."""
    if names := fields_of(value):
        return {name: plain(getattr(value, name)) for name in names}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in (sorted(value) if isinstance(value, set | frozenset) else value)]
    if isinstance(value, bytes):
        return {"bytes": len(value), "sha256": hashlib.sha256(value).hexdigest()}
    if isinstance(value, enum.Enum):
        return value.value
    return (
        value
        if value is None or isinstance(value, str | int | float)
        else MASK
        if isinstance(value, Hidden)
        else str(value)
    )
