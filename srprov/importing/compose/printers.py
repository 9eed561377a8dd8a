"""One value -> what Compose prints of it, by the type that its key has for Compose. Pure."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from srprov.importing.compose import amounts, casts, words
from srprov.importing.compose.scalars import shown, single
from srprov.importing.compose.values import Value, refuse
from srprov.importing.position import Path

Printer = Callable[[Value, Path], object]


def text(value: Value, path: Path) -> object:
    """Return text; numbers with a fraction, and booleans, are none to Compose."""
    if isinstance(value.data, bool | float):
        raise refuse(value, f"'{path[-1]}' must be text", path, "quote it")
    return shown(value.data)


def any_text(value: Value, path: Path) -> object:
    """Return any scalar as text."""
    return shown(value.data)


def flag(value: Value, path: Path) -> object:
    """Return a boolean; words for one count."""
    return _read(value, path, casts.boolean, bool)


def whole(value: Value, path: Path) -> object:
    """Return a whole number; of one with a fraction, Compose takes the whole part."""
    data = _read(value, path, casts.integer, int | float)
    assert isinstance(data, int | float)
    if not -(2**63) <= data < 2**63:
        raise refuse(value, f"'{path[-1]}' is too large", path)
    return int(data)


def counted(value: Value, path: Path) -> object:
    """Return a whole number that is not negative."""
    number = whole(value, path)
    assert isinstance(number, int)
    if number < 0:
        raise refuse(value, f"'{path[-1]}' must not be negative", path)
    return number


def bare(value: Value, path: Path) -> object:
    """Return a whole number that must not be written as text."""
    if isinstance(value.data, str):
        raise refuse(value, f"'{path[-1]}' must be a number, without quotes", path)
    return counted(value, path)


def fraction(value: Value, path: Path) -> object:
    """Return a number as Compose holds it, in 32 bits."""
    data = _read(value, path, casts.number, int | float)
    assert isinstance(data, int | float)
    if abs(data) > 3e38:
        raise refuse(value, f"'{path[-1]}' is too large", path)
    number = single(data)
    return int(number) if number.is_integer() else number


def size(value: Value, path: Path) -> object:
    """Return bytes, as text; what is zero says nothing."""
    if isinstance(value.data, float):
        raise refuse(value, f"'{path[-1]}' has a fraction, and Compose would take it for nothing", path)
    number = _read(value, path, amounts.size, int)
    return str(number) if number else ""


def duration(value: Value, path: Path) -> object:
    """Return a duration as Compose prints it."""
    nano = _read(value, path, amounts.nanoseconds, ())
    assert isinstance(nano, int)
    return amounts.show_duration(nano)


def some_duration(value: Value, path: Path) -> object:
    """Return a duration; none says nothing."""
    printed = duration(value, path)
    return "" if printed == "0s" else printed


def _read(value: Value, path: Path, read: Callable[[str], object], ready: type | tuple[()] | object) -> object:
    data = value.data
    if isinstance(data, str):
        try:
            return read(data)
        except ValueError as error:
            raise refuse(value, f"'{path[-1]}': {error}", path) from None
    if isinstance(data, bool) and ready is not bool:
        raise refuse(value, f"'{path[-1]}' is true or false, which it cannot be", path)
    return data


def mode(value: Value, path: Path) -> object:
    """Return the rights of a file, in octal digits."""
    if isinstance(value.data, float):
        raise refuse(value, f"'{path[-1]}' must be a whole number", path)
    number = _read(value, path, _octal, int)
    assert isinstance(number, int)
    return f"{'-' if number < 0 else ''}0{abs(number):o}"


def _octal(digits: str) -> int:
    if not re.fullmatch("[0-7]{1,20}", digits):
        raise ValueError(f"'{digits[:40]}' are no octal digits")
    return int(digits, 8)


def device_count(value: Value, path: Path) -> object:
    """Return a number of devices; all are -1."""
    return -1 if isinstance(value.data, str) and value.data.lower() == "all" else whole(value, path)


def command(value: Value, path: Path) -> object:
    """Return the words of a command; none at all is another thing than an empty one."""
    if not isinstance(value.data, str):
        return value.data
    try:
        return [Value(word, value.at) for word in words.split(value.data)]
    except ValueError as error:
        raise refuse(value, f"the command cannot be split into words: {error}", path) from None


def test(value: Value, path: Path) -> object:
    """Return a health check's words; one text is for a shell."""
    if isinstance(value.data, str):
        return [Value(word, value.at) for word in ("CMD-SHELL", value.data)]
    return value.data


def pairs(value: Value, path: Path) -> object:
    """Return a map of texts from either way to write one; nothing is empty text."""
    return {name: item.of(shown(item.data)) for name, item in _pairs(value, path).items()}


def strict_pairs(value: Value, path: Path) -> object:
    """Return a map of texts; other numbers than whole ones are none."""
    return {name: item.of(text(item, (*path, name))) for name, item in value.data.items()}


def open_pairs(value: Value, path: Path) -> object:
    """Return a map of texts in which a name alone has no value yet."""
    return {
        name: item if item.data is None else item.of(shown(item.data)) for name, item in _pairs(value, path).items()
    }


def _pairs(value: Value, path: Path) -> Mapping[str, Value]:
    if isinstance(value.data, dict):
        return value.data
    found: dict[str, Value] = {}
    for number, item in enumerate(value.data):
        name, sign, word = shown(item.data).partition("=")
        if name != name.rstrip() and path[-1] == "environment":
            raise refuse(item, f"the name of a variable ends in a space: '{name[:60]}'", (*path, number))
        found[name] = Value(word if sign else None, item.at, item.at)
    return found


def hosts(value: Value, path: Path) -> object:
    """Return further hosts as `name=address`, in the order of these texts."""
    entries: list[Value] = []
    for name, item in value.data.items() if isinstance(value.data, dict) else ():
        entries += [
            one.of(f"{name}={_bare(one.data)}") for one in (item.data if isinstance(item.data, list) else [item])
        ]
    for number, item in enumerate(value.data if isinstance(value.data, list) else ()):
        name, sign, address = item.data.partition("=")
        if not sign:
            name, sign, address = item.data.partition(":")
        if not sign or not address:
            raise refuse(item, f"'{item.data[:100]}' has no address", (*path, number))
        entries.append(item.of(f"{name}={_bare(address)}"))
    return sorted(entries, key=lambda entry: entry.data)


def _bare(address: str) -> str:
    return address[1:-1] if address[:1] == "[" and address[-1:] == "]" else address


def ulimit(value: Value, path: Path) -> object:
    """Return a limit as one number, or as two."""
    if not isinstance(value.data, dict):
        return whole(value, path) or {}
    limits = {
        name: item.of(whole(item, (*path, name))) for name, item in value.data.items() if name in ("soft", "hard")
    }
    return {name: item for name, item in limits.items() if item.data}


def ulimits(value: Value, path: Path) -> object:
    """Return all limits of a service."""
    return {name: item.of(ulimit(item, (*path, name))) for name, item in value.data.items()}


def texts(value: Value, path: Path) -> object:
    """Return a list of texts."""
    if not isinstance(value.data, list):
        return [value.of(text(value, path))]
    return [item.of(text(item, (*path, number))) for number, item in enumerate(value.data)]
