"""Parameters of a resource: from what a playbook wrote to the dataclass of its module, by the types of its fields.

A field may be `str`, `AnyText`, `Mode`, `int`, `float`, `bool`, `bytes` (written as the sha256 of a blob), a `Literal`
of texts, `Any`, `Mapping[str, X]`, `tuple[X, ...]`, `tuple[X, Y]`, another such dataclass, or a union of those that
differ in JSON (`X | None`). One with a default may be left out. A trailing underscore keeps a name apart from Python's
words: `from_` is written `from`. What types cannot say is checked in `__post_init__`, which raises `ParameterError`.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import re
import types
from collections.abc import Mapping
from typing import Any, Literal, NewType, TypeVar, cast, get_args, get_origin, get_type_hints

P = TypeVar("P")

AnyText = NewType("AnyText", str)
"""Text that may hold NUL, which neither a shell's word nor a variable can."""
Mode = NewType("Mode", int)
"""Permissions, written as octal digits: `0644`."""
NOT_WRITTEN = {"written": False}
"""Metadata of a field that is no parameter of a playbook."""

_JSON: dict[Any, tuple[type | tuple[type, ...], str]] = {
    str: (str, "text"),
    AnyText: (str, "text"),
    Mode: (str, "octal digits such as 0644"),
    bytes: (str, "the sha256 of a blob"),
    bool: (bool, "true or false"),
    int: (int, "a whole number"),
    float: ((int, float), "a number"),
    tuple: (list, "a list"),
    Mapping: (Mapping, "a map"),
    type(None): (type(None), "null"),
    Any: (object, "a value"),
}
"""Type of a field -> what it is in JSON, in Python and in words."""


class ParameterError(ValueError):
    """A parameter that its module cannot take."""

    def __init__(self, at: str, message: str) -> None:
        """Take the parameter, and the way to a value inside of it, such as `run.devices.0`; and what is wrong."""
        super().__init__(message)
        self.key = at.partition(".")[0]


def read_params(kind: type[P], written: Mapping[str, Any], blobs: Mapping[str, bytes], *, at: str = "") -> P:
    """Return the parameters that a playbook wrote.

    Args:
        kind: The dataclass of the module's parameters.
        written: Parameter -> JSON value.
        blobs: sha256 -> bytes.
        at: The way to the parameter that they are inside of, with a dot at its end.

    Raises:
        ParameterError: One is not known, is missing or has another type.
    """
    fields = _fields(kind)  # type: ignore[arg-type] # a class can be hashed, whatever its instances can
    for key in written.keys() - fields.keys():
        raise ParameterError(at + str(key), f"there is no parameter '{at}{key}', only {', '.join(fields)}")
    for key in [key for key, (_, _, required) in fields.items() if required and key not in written]:
        raise ParameterError(at + key, f"the parameter '{at}{key}' is missing")
    return kind(**{fields[key][0]: _value(fields[key][1], written[key], at + key, blobs) for key in written})


def check_text(text: str, at: str, *, nul: bool = False) -> str:
    """Return a text that can be sent to a robot, and unless it may hold NUL, as a word of its shell too."""
    if "\0" in text and not nul:
        raise ParameterError(at, f"{at} holds a NUL, which no shell word can")
    if re.search("[\ud800-\udfff]", text):
        raise ParameterError(at, f"{at} holds half a character, which is no UTF-8")
    return text


@functools.cache
def _fields(kind: type[Any]) -> dict[str, tuple[str, Any, bool]]:
    """Return parameter -> field, its type, and whether it must be given; of a dataclass."""
    hints, none = get_type_hints(kind), dataclasses.MISSING
    return {
        field.name.rstrip("_"): (field.name, hints[field.name], field.default is none and field.default_factory is none)
        for field in dataclasses.fields(kind)
        if field.metadata != NOT_WRITTEN
    }


def _value(hint: Any, value: Any, at: str, blobs: Mapping[str, bytes]) -> Any:  # noqa: ANN401 - any type, any JSON
    options = get_args(hint) if get_origin(hint) is types.UnionType else (hint,)
    hint = next((one for one in options if _fits(_base(one), value)), None)
    if hint is None:
        wanted = " or ".join(_JSON[_base(one)][1] for one in options)
        raise ParameterError(at, f"{at}: expected {wanted}, not {json.dumps(value)[:60]}")
    base, inner = _base(hint), get_args(hint)
    if dataclasses.is_dataclass(hint):
        return read_params(cast("type[Any]", hint), value, blobs, at=f"{at}.")
    if base is bytes and value not in blobs:
        raise ParameterError(at, f"there is no blob {value!r}")
    if base is tuple:
        hints = inner[:1] * len(value) if inner[1:] == (...,) else inner
        if len(hints) != len(value):
            raise ParameterError(at, f"{at}: expected {len(hints)} values, not {len(value)}")
        return tuple(_value(hints[index], one, f"{at}.{index}", blobs) for index, one in enumerate(value))
    if base is Mapping:
        return {check_text(str(key), at): _value(inner[1], one, f"{at}.{key}", blobs) for key, one in value.items()}
    if get_origin(hint) is Literal and value not in inner:
        raise ParameterError(at, f"{at}: expected one of {', '.join(inner)}, not {value!r}")
    if base in (str, AnyText):
        return check_text(value, at, nul=base is AnyText)
    return blobs[value] if base is bytes else int(value, 8) if base is Mode else value


def _base(hint: Any) -> Any:  # noqa: ANN401 - any type
    """Return the key of a type in the table."""
    origin = get_origin(hint)
    return str if origin is Literal else Mapping if dataclasses.is_dataclass(hint) else origin or hint


def _fits(base: Any, value: object) -> bool:  # noqa: ANN401 - any type
    if base is Mode:
        return isinstance(value, str) and re.fullmatch("[0-7]{3,4}", value) is not None
    # to Python, true is a number
    return isinstance(value, _JSON[base][0]) and (not isinstance(value, bool) or base in (bool, Any))
