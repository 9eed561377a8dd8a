"""What a variable is worth, and where that comes from. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import msgspec


class Origin(msgspec.Struct, frozen=True):
    """A variable's value, and where it comes from: `--set` or the name of a file."""

    value: str
    source: str


class Both(Mapping[str, Origin]):
    """Two maps as one; the first wins. The second may still grow."""

    def __init__(self, first: Mapping[str, Origin], second: Mapping[str, Origin]) -> None:
        self.first = first
        self.second = second

    def __getitem__(self, name: str) -> Origin:
        return self.first[name] if name in self.first else self.second[name]

    def __iter__(self) -> Iterator[str]:
        return iter({*self.first, *self.second})

    def __len__(self) -> int:
        return len({*self.first, *self.second})
