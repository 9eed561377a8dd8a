"""Parameters of a resource: from what a playbook wrote to the dataclass of its module, by the types of its fields.

A field may be `str`, `AnyText`, `int`, `float`, `bool`, `bytes` (written as the sha256 of a blob), a `Literal` of
texts, `Any`, `Mapping[str, X]`, `tuple[X, ...]`, `tuple[X, Y]`, another such dataclass, or a union of those that differ
in JSON (`X | None`). One with a default may be left out. A trailing underscore keeps a name apart from Python's words:
`from_` is written `from`. What types cannot say is checked in `__post_init__`, which raises `ParameterError`.
"""

from __future__ import annotations

import dataclasses
import functools
import types
from collections.abc import Mapping
from typing import Any, Literal, NewType, TypeVar, cast, get_args, get_origin, get_type_hints

P = TypeVar("P")

AnyText = NewType("AnyText", str)
"""Text that may hold NUL, which neither a shell's word nor a variable can."""

NOT_WRITTEN = {"written": False}
"""Metadata of a field that is no parameter of a playbook."""

_SHAPES: dict[Any, tuple[type | tuple[type, ...], str]] = {
    str: (str, "text"),
    AnyText: (str, "text"),
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

    def __init__(self, key: str, message: str) -> None:
        """Take the parameter as the playbook names it, and what is wrong."""
        super().__init__(message)
        self.key = key


def read_params(kind: type[P], written: Mapping[str, Any], blobs: Mapping[str, bytes], *, at: str = "") -> P:
    """Return the parameters that a playbook wrote.

    Args:
        kind: The dataclass of the module's parameters.
        written: Parameter -> JSON value.
        blobs: sha256 -> bytes.
        at: The parameter that they are inside of.

    Raises:
        ParameterError: One is not known, is missing or has another type.
    """
    fields = _fields(kind)  # type: ignore[arg-type] # a class can be hashed, whatever its instances can
    prefix = f"{at}." if at else ""
    for key in written:
        if key not in fields:
            known = ", ".join(fields)
            raise ParameterError(at or str(key), f"there is no parameter '{prefix}{key}', only {known}")
    for key, (_, _, required) in fields.items():
        if required and key not in written:
            raise ParameterError(at or key, f"the parameter '{prefix}{key}' is missing")
    return kind(
        **{
            name: _value(hint, written[key], prefix + key, blobs)
            for key, (name, hint, _) in fields.items()
            if key in written
        }
    )


def octal(text: str) -> int:
    """Return the permissions that octal digits such as `0644` mean."""
    if not 0 < len(text) <= len("0644") or not set(text) <= set("01234567"):
        raise ParameterError("mode", f"a mode is octal digits such as 0644, not {text!r}")
    return int(text, 8)


def check_text(text: str, at: str) -> str:
    """Return a text that can be sent to a robot, as a word of its shell too."""
    if "\0" in text:
        raise ParameterError(at.partition(".")[0], f"{at} holds a NUL, which no shell word can")
    return _encodable(text, at)


@functools.cache
def _fields(kind: type[Any]) -> dict[str, tuple[str, Any, bool]]:
    """Return parameter -> field, its type, and whether it must be given; of a dataclass."""
    hints = get_type_hints(kind)
    return {
        field.name.rstrip("_"): (field.name, hints[field.name], field.default is dataclasses.MISSING)
        for field in dataclasses.fields(kind)
        if field.metadata != NOT_WRITTEN
    }


def _value(hint: Any, value: Any, at: str, blobs: Mapping[str, bytes]) -> Any:  # noqa: ANN401 - any type, any JSON
    options = get_args(hint) if get_origin(hint) is types.UnionType else (hint,)
    hint = next((one for one in options if _fits(one, value)), None)
    if hint is None:
        wanted = " or ".join(_SHAPES[_base(one)][1] for one in options)
        raise ParameterError(at.partition(".")[0], f"{at}: expected {wanted}, not {_said(value)}")
    base, inner = _base(hint), get_args(hint)
    if dataclasses.is_dataclass(hint):
        return read_params(cast("type[Any]", hint), value, blobs, at=at)
    if base is bytes:
        if value not in blobs:
            raise ParameterError(at, f"there is no blob {value!r}")
        return blobs[value]
    if base is tuple:
        return _items(inner, value, at, blobs)
    if base is Mapping:
        return {check_text(str(key), at): _value(inner[1], one, f"{at}.{key}", blobs) for key, one in value.items()}
    if inner and value not in inner:
        raise ParameterError(at.partition(".")[0], f"{at}: expected one of {', '.join(inner)}, not {value!r}")
    if base is str:
        return check_text(value, at)
    return _encodable(value, at) if base is AnyText else value


def _items(inner: tuple[Any, ...], value: list[Any], at: str, blobs: Mapping[str, bytes]) -> tuple[Any, ...]:
    hints = inner[:1] * len(value) if inner[1:] == (...,) else inner
    if len(hints) != len(value):
        raise ParameterError(at.partition(".")[0], f"{at}: expected {len(hints)} values, not {len(value)}")
    return tuple(
        _value(hint, one, f"{at}.{index}", blobs) for index, (hint, one) in enumerate(zip(hints, value, strict=True))
    )


def _base(hint: Any) -> Any:  # noqa: ANN401 - any type
    """Return the key of a type in the table of shapes."""
    origin = get_origin(hint)
    return str if origin is Literal else Mapping if dataclasses.is_dataclass(hint) else origin or hint


def _fits(hint: Any, value: object) -> bool:  # noqa: ANN401 - any type
    base = _base(hint)
    # to Python, true is a number
    return isinstance(value, _SHAPES[base][0]) and (not isinstance(value, bool) or base in (bool, Any))


def _said(value: object) -> str:
    """Return what a JSON value is, in words."""
    named = (bool, int, float, str, list, dict, type(None))
    kind = next((one for one in named if isinstance(value, one)), type(value))
    shapes = {shape: word for shape, word in _SHAPES.values() if isinstance(shape, type)}
    return {str: "text", dict: "a map", float: "a number"}.get(kind, shapes.get(kind, kind.__name__))


def _encodable(text: str, at: str) -> str:
    try:
        text.encode()
    except UnicodeEncodeError as error:
        raise ParameterError(at.partition(".")[0], f"{at} holds half a character: {error.reason}") from error
    return text
