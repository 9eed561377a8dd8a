"""A tree of values that know their place: what all of Compose's rules take and give.

Trees are never changed: a rule that changes something makes new nodes. Pure.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.normal import Refused
from srprov.importing.position import Path, Position

Scalar = str | int | float | bool | None


class Value(msgspec.Struct, frozen=True, eq=False):
    """One node: a map of nodes, a list of nodes, or a scalar."""

    data: Any
    """`dict[str, Value]`, `list[Value]` or a scalar."""
    at: Position
    key: Position | None = None
    """Where the key of this entry is written; None in lists, and for what a rule has put in."""
    tag: str = ""
    """`!reset` or `!override`."""

    def of(self, data: object) -> Value:
        """Return the same place with other data."""
        return replace(self, data=data, tag="")

    def get(self, name: str) -> Value | None:
        """Return an entry of a map; None when this is no map or has none such."""
        return self.data.get(name) if isinstance(self.data, dict) else None

    @property
    def place(self) -> Position:
        """Where the entry begins: its key, if it has one."""
        return self.key or self.at


def dotted(path: Path) -> str:
    """Return a path as it is shown: `services.talker.ports.0`."""
    return ".".join(str(part) for part in path)


def wrong(value: Value, message: str, path: Path = (), hint: str = "") -> Diagnostic:
    """Return a problem at a value; at its key where it has one and is no scalar."""
    place = value.place if isinstance(value.data, dict | list) else value.at
    return Diagnostic(place, message, dotted(path), "", hint, code=Code.COMPOSE)


def refuse(value: Value, message: str, path: Path = (), hint: str = "") -> Refused:
    """Return the refusal of one value, to be raised."""
    return Refused([wrong(value, message, path, hint)])


def plain(value: Value) -> Any:  # noqa: ANN401 - JSON
    """Return a tree's data alone."""
    data = value.data
    if isinstance(data, dict):
        return {name: plain(item) for name, item in data.items()}
    if isinstance(data, list):
        return [plain(item) for item in data]
    return data


def grown(data: object, at: Position) -> Value:
    """Return a tree for plain data that a rule puts in, all at one place."""
    if isinstance(data, Value):
        return data
    if isinstance(data, Mapping):
        return Value({name: grown(item, at) for name, item in data.items()}, at)
    if isinstance(data, list | tuple):
        return Value([grown(item, at) for item in data], at)
    return Value(data, at)


def places(value: Value, path: Path = ()) -> Iterator[tuple[Path, Position]]:
    """Yield the place of each value of a tree, by its path."""
    yield path, value.place
    if isinstance(value.data, dict):
        for name, item in value.data.items():
            yield from places(item, (*path, name))
    elif isinstance(value.data, list):
        for number, item in enumerate(value.data):
            yield from places(item, (*path, number))


class Rules:
    """What to do at which paths: patterns such as `services.*.ports`, kept so that a walk sees only what may match."""

    def __init__(self, patterns: Mapping[str, Any]) -> None:
        """Take patterns with dots; `*` stands for any one part."""
        self.here: Any = None
        self.below: dict[str, Rules] = {}
        for pattern, rule in patterns.items():
            node = self
            for part in pattern.split("."):
                node = node.below.setdefault(part, Rules({}))
            node.here = rule

    def step(self, part: str | int) -> Rules | None:
        """Return the rules below one part of a path; None when there are none."""
        return self.below.get(str(part)) or self.below.get("*")


def rewrite(value: Value, rules: Rules | None, apply: Callable[[Any, Value, Path], Value], path: Path = ()) -> Value:
    """Return the tree with each rule applied where its pattern matches, inner values first."""
    if rules is None:
        return value
    data = value.data
    if rules.below and isinstance(data, dict):
        value = replace(
            value, data={name: rewrite(item, rules.step(name), apply, (*path, name)) for name, item in data.items()}
        )
    elif rules.below and isinstance(data, list):
        items = [rewrite(item, rules.step(number), apply, (*path, number)) for number, item in enumerate(data)]
        value = replace(value, data=items)
    return value if rules.here is None else apply(rules.here, value, path)


def text_list(value: Value) -> Sequence[Value]:
    """Return the items of a list, or one text as a list of one."""
    return value.data if isinstance(value.data, list) else [value]
