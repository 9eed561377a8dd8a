"""Parameters of a resource: from what a playbook wrote to the values of its module, by the types of its fields.

A field may be `str`, `AnyText`, `Mode`, `int`, `float`, `bool`, `bytes` (written as the sha256 of a blob), a `Literal`
of texts, `Any`, `Mapping[str, X]`, `tuple[X, ...]`, `tuple[X, Y]`, another such Struct, or a union of those that
differ in JSON (`X | None`). One with a default may be left out. A trailing underscore keeps a name apart from Python's
words: `from_` is written `from`. What types cannot say is checked in `__post_init__`, which raises `ParameterError`.
"""

from __future__ import annotations

import functools
import json
import re
import types
from collections.abc import Mapping
from ipaddress import IPv4Address
from typing import Annotated, Any, Literal, NewType, TypeVar, Union, get_args, get_origin

import msgspec

P = TypeVar("P")

AnyText = NewType("AnyText", str)
"""Text that may hold NUL, which neither a shell's word nor a variable can."""
Mode = NewType("Mode", int)
"""Permissions, written as octal digits: `0644`."""
NOT_WRITTEN = "not written"
"""Annotation of a field that is no parameter of a playbook: `Annotated[X, NOT_WRITTEN]`."""

_Options = tuple[tuple[Any, Any, tuple[Any, ...]], ...]
_JSON: dict[Any, tuple[type | tuple[type, ...], str]] = {
    str: (str, "text"),
    AnyText: (str, "text"),
    Mode: (str, "octal digits such as 0644"),
    bytes: (str, "the sha256 of a blob"),
    bool: (bool, "true or false"),
    int: (int, "a whole number"),
    float: ((int, float), "a number"),
    tuple: (list, "a list"),
    Mapping: (dict, "a map"),
    type(None): (type(None), "null"),
    Any: (object, "a value"),
}
"""Type of a field -> what it is in JSON, in Python and in words."""


_MAC = re.compile(r"[0-9a-f]{2}(:[0-9a-f]{2}){5}")


class ParameterError(ValueError):
    """A parameter that its module cannot take."""

    def __init__(self, at: str, message: str) -> None:
        """Take the parameter, and the way to a value inside of it, such as `run.devices.0`; and what is wrong."""
        super().__init__(message)
        self.key = at.partition(".")[0]


def read_params(kind: type[P], written: Mapping[str, Any], blobs: Mapping[str, bytes], *, at: str = "") -> P:
    """Return the parameters that a playbook wrote.

    Args:
        kind: The Struct of the module's parameters.
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
    if not text.isascii() and re.search("[\ud800-\udfff]", text):
        raise ParameterError(at, f"{at} holds half a character, which is no UTF-8")
    return text


def check_mac(text: str, at: str) -> None:
    """Refuse a MAC in another spelling than one: tools take several, and the same one twice must be seen."""
    if not _MAC.fullmatch(text):
        raise ParameterError(at, f"{at}: '{text[:40]}' is no MAC as '02:00:00:00:00:0a'")


def check_ipv4(text: str, at: str) -> None:
    """Refuse what is no IPv4 address in its one spelling."""
    try:
        IPv4Address(text)
    except ValueError as error:
        raise ParameterError(at, f"{at}: '{text[:40]}' is no IPv4 address") from error


@functools.cache
def _fields(kind: type[Any]) -> dict[str, tuple[str, _Options, bool]]:
    """Return parameter -> field, its type, and whether it must be given; of a Struct."""
    return {
        field.name.rstrip("_"): (field.name, _options(field.type), field.required)
        for field in msgspec.structs.fields(kind)
        if get_origin(field.type) is not Annotated or NOT_WRITTEN not in get_args(field.type)
    }


@functools.cache
def _options(hint: Any) -> _Options:  # noqa: ANN401 - any type
    """Return the options of a type, each with its key in the table and its own parameters."""
    found = []
    for one in get_args(hint) if get_origin(hint) in (types.UnionType, Union) else (hint,):
        origin = get_origin(one)
        base = str if origin is Literal else Mapping if _is_struct(one) else origin or one
        found.append((one, base, get_args(one)))
    return tuple(found)


def _is_struct(hint: Any) -> bool:  # noqa: ANN401 - any type
    return isinstance(hint, type) and issubclass(hint, msgspec.Struct)


def _value(options: _Options, value: Any, at: str, blobs: Mapping[str, bytes]) -> Any:  # noqa: ANN401 - any JSON
    for option, base, inner in options:
        # to Python, true is a number
        if isinstance(value, _JSON[base][0]) and (value.__class__ is not bool or base in (bool, Any)):
            return _converted(option, base, inner, value, at, blobs)
    wanted = " or ".join(_JSON[base][1] for _, base, _ in options if base is not type(None))  # it may be left out
    raise ParameterError(at, f"{at}: expected {wanted}, not {json.dumps(value)[:60]}")


def _converted(
    hint: Any,  # noqa: ANN401 - any type
    base: Any,  # noqa: ANN401 - any type
    inner: tuple[Any, ...],
    value: Any,  # noqa: ANN401 - any JSON
    at: str,
    blobs: Mapping[str, bytes],
) -> Any:  # noqa: ANN401 - any value
    if base in (str, AnyText):
        if inner and value not in inner:
            raise ParameterError(at, f"{at}: expected one of {', '.join(inner)}, not {value!r}")
        return check_text(value, at, nul=base is AnyText)
    if base is Mode:
        if not re.fullmatch("[0-7]{3,4}", value):
            raise ParameterError(at, f"{at}: expected octal digits such as 0644, not {value!r}")
        return int(value, 8)
    if base is bytes:
        if value not in blobs:
            raise ParameterError(at, f"there is no blob {value!r}")
        return blobs[value]
    if base is tuple:
        hints = inner[:1] * len(value) if inner[1:] == (...,) else inner
        if len(hints) != len(value):
            raise ParameterError(at, f"{at}: expected {len(hints)} values, not {len(value)}")
        return tuple(_value(_options(hints[index]), one, f"{at}.{index}", blobs) for index, one in enumerate(value))
    if base is Mapping and inner:
        return {
            check_text(str(key), at): _value(_options(inner[1]), one, f"{at}.{key}", blobs)
            for key, one in value.items()
        }
    return read_params(hint, value, blobs, at=f"{at}.") if base is Mapping else _checked(value, at)


def _checked(value: Any, at: str) -> Any:  # noqa: ANN401 - any JSON
    """Return a value of any form; the engine would read half a character as another one, and compare other texts."""
    if isinstance(value, str):
        check_text(value, at, nul=True)
    for key, one in (
        value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
    ):
        check_text(str(key), at, nul=True)
        _checked(one, f"{at}.{key}")
    return value
