"""A project's tree against the table of shapes, and against what several keys must be together. Pure.

Every problem is found, each with its place.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from srprov.errors import Diagnostic, did_you_mean
from srprov.importing.compose import ports
from srprov.importing.compose.scalars import Date, shown
from srprov.importing.compose.shapes_more import ALL_TABLES, CLOSED, PATTERNS, REQUIRED
from srprov.importing.compose.values import Rules, Value, plain, refuse, rewrite, wrong
from srprov.importing.normal import Refused
from srprov.importing.position import Path

_NAME = re.compile("[a-zA-Z0-9._-]+")
_PATTERN_RULES = Rules({path: re.compile(pattern) for path, pattern in PATTERNS.items()})
_WORDS = {"text": "text", "bool": "true or false", "int": "a whole number", "number": "a number", "null": "nothing"}
MOST_PROBLEMS = 50


def shape(tree: Value) -> None:
    """Check a tree's keys and kinds of values.

    Raises:
        Refused: With all that is wrong.
    """
    checking = _Checking()
    checking.table(tree, "project", ())
    rewrite(tree, _PATTERN_RULES, checking.pattern)
    if checking.problems:
        raise Refused(checking.problems[:MOST_PROBLEMS])


@cache
def alternatives(kind: str) -> tuple[str, ...]:
    """Split a kind at its outer `|`."""
    parts, depth, begin = [], 0, 0
    for index, char in enumerate(kind):
        depth += (char in "[{<(") - (char in "]}>)")
        if char == "|" and depth == 0:
            parts.append(kind[begin:index])
            begin = index + 1
    return (*parts, kind[begin:])


class _Checking:
    def __init__(self) -> None:
        self.problems: list[Diagnostic] = []

    def problem(self, value: Value, message: str, path: Path, hint: str = "") -> None:
        if len(self.problems) < MOST_PROBLEMS:
            self.problems.append(wrong(value, message, path, hint))

    def table(self, value: Value, name: str, path: Path) -> None:
        keys = ALL_TABLES[name]
        for key, item in value.data.items():
            if key in keys:
                self.kind(item, keys[key], (*path, key))
            elif name in CLOSED or not key.startswith("x-"):
                self.problem(
                    Value(None, item.place),
                    f"Compose has no key '{key[:60]}' here",
                    (*path, key),
                    did_you_mean(key, keys),
                )
        for key in REQUIRED.get(name, ()):
            if key not in value.data:
                self.problem(value, f"'{key}' is missing", path)

    def kind(self, value: Value, kind: str, path: Path) -> None:
        for one in alternatives(kind):
            if self._is(value, one, path):
                return
        what = " or ".join(dict.fromkeys(_in_words(one) for one in alternatives(kind)))
        data = value.data
        said = (
            ""
            if isinstance(data, dict | list)
            else f", not '{shown(data)[:60]}'"
            if data is not None
            else ", not nothing"
        )
        quote = "quote it" if "text" in what and not isinstance(data, dict | list) and data is not None else ""
        self.problem(value, f"'{path[-1]}' must be {what}{said}", path, quote)

    def _is(self, value: Value, kind: str, path: Path) -> bool:
        """Return whether a value is of a kind; what is wrong inside of it is a problem of its own."""
        data = value.data
        if kind[0] == "@":
            if isinstance(data, dict):
                self.table(value, kind[1:], path)
            return isinstance(data, dict)
        if kind[0] in "{<":
            return self._is_map(value, kind, path)
        if kind[0] == "[":
            return self._is_list(value, kind, path)
        word, _, bounds = kind.rstrip(")").partition("(")
        if isinstance(data, dict | list):
            return False
        return _is_scalar(data, word) and (not bounds or _within(data, bounds, word))

    def _is_map(self, value: Value, kind: str, path: Path) -> bool:
        if not isinstance(value.data, dict):
            return False
        for key, item in value.data.items():
            if (kind[0] == "<" and not _NAME.fullmatch(key)) or not key:
                self.problem(
                    Value(None, item.place), f"'{key[:60]}' is no name: letters, digits, '.', '_' and '-'", path
                )
            else:
                self.kind(item, kind[1:-1], (*path, key))
        return True

    def _is_list(self, value: Value, kind: str, path: Path) -> bool:
        if not isinstance(value.data, list):
            return False
        inner = kind.removesuffix("!")[1:-1]
        for number, item in enumerate(value.data):
            self.kind(item, inner, (*path, number))
        if kind.endswith("!"):
            self._no_two_alike(value.data, path)
        return True

    def _no_two_alike(self, items: Sequence[Value], path: Path) -> None:
        seen: set[str] = set()
        for number, item in enumerate(items):
            text = repr(plain(item))
            if text in seen:
                self.problem(item, "this entry is there twice", (*path, number))
            seen.add(text)

    def pattern(self, pattern: re.Pattern[str], value: Value, path: Path) -> Value:
        """Note a text that does not have what it must have."""
        if isinstance(value.data, str) and not pattern.search(value.data):
            self.problem(value, f"'{value.data[:60]}' is not what '{path[-1]}' may be: {pattern.pattern}", path)
        return value


def _is_scalar(data: object, word: str) -> bool:
    if word == "text":
        return isinstance(data, str) and not isinstance(data, Date)
    if word == "null":
        return data is None
    if isinstance(data, bool) or word == "bool":
        return isinstance(data, bool) and word == "bool"
    if word == "int":
        return isinstance(data, int) or (isinstance(data, float) and data.is_integer())
    return isinstance(data, int | float)


def _within(data: Any, bounds: str, word: str) -> bool:  # noqa: ANN401 - a scalar of the kind
    if word == "text":
        return data in bounds.split(",")
    least, most = bounds.split(",")
    return (not least or data >= int(least)) and (not most or data <= int(most))


def _in_words(kind: str) -> str:
    if kind[0] in "@{<":
        return "a map"
    if kind[0] == "[":
        return "a list"
    word, _, bounds = kind.rstrip(")").partition("(")
    if not bounds:
        return _WORDS[word]
    return (
        f"one of {bounds.replace(',', ', ')}"
        if word == "text"
        else f"a whole number from {bounds.replace(',', ' to ')}"
    )


def sense(tree: Value) -> None:
    """Check what several keys must be together.

    Raises:
        Refused: With the first that is wrong.
    """
    rewrite(tree, _SENSE, lambda rule, value, path: rule(value, path))


def _external(value: Value, path: Path) -> Value:
    external = value.get("external")
    if external is None or external.data in (False, None):
        return value
    for name, item in value.data.items():
        if name not in ("name", "external") and not name.startswith("x-"):
            raise refuse(item, f"what is external has no '{name}' here", path)
    return value


def _one_of(*names: str) -> Callable[[Value, Path], Value]:
    """Return a check that exactly one of some keys is there."""

    def check(value: Value, path: Path) -> Value:
        have = [name for name in names if value.get(name) is not None]
        if len(have) > 1:
            raise refuse(value, f"only one of {', '.join(names)} may be there", path)
        if not have and value.get("driver") is None and value.get("external") is None:
            raise refuse(value, f"one of {', '.join(names)} must be there", path)
        return value

    return check


def _address(value: Value, path: Path) -> Value:
    host = value.get("host_ip")
    if host is not None and not (isinstance(host.data, str) and ports.is_address(host.data)):
        raise refuse(host, f"'{shown(host.data)[:100]}' is no IP address", path)
    return value


def _device_request(value: Value, path: Path) -> Value:
    if value.get("count") is not None and value.get("device_ids") is not None:
        raise refuse(value, "only one of count, device_ids may be there", path)
    return value


def _not_blank(value: Value, path: Path) -> Value:
    if value.data == "":
        raise refuse(value, "the path is empty", path)
    return value


_SENSE = Rules(
    {
        "volumes.*": _external,
        "configs.*": _one_of("file", "environment", "content"),
        "secrets.*": _one_of("file", "environment"),
        "services.*.ports.*": _address,
        "services.*.develop.watch.*.path": _not_blank,
        "services.*.deploy.resources.reservations.devices.*": _device_request,
        "services.*.gpus.*": _device_request,
    }
)
