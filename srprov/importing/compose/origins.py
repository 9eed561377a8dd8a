"""What a variable is worth, where that comes from, and which files it is for. Pure."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from shlex import quote

import msgspec

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.position import Position


class Origin(msgspec.Struct, frozen=True):
    """A variable's value, and where it comes from: `--set` or the name of a file."""

    value: str
    source: str
    home: str = ""
    """Real path of the folder whose files alone it is for: nobody named the file in which it stands. Empty: of all."""

    def is_for(self, folders: Collection[str]) -> bool:
        """Return whether a file may take it whose variables are those of some folders."""
        return not self.home or (bool(folders) and all(one == self.home for one in folders))


class Both(Mapping[str, Origin]):
    """Two maps as one; the first wins. The second may still grow."""

    def __init__(self, first: Mapping[str, Origin], second: Mapping[str, Origin]) -> None:
        self.first = first
        self.second = second

    def __getitem__(self, name: str) -> Origin:
        return self.first[name] if name in self.first else self.second[name]

    def every(self, name: str) -> list[Origin]:
        """Return all that a name is worth, the one that wins first."""
        return [*every(self.first, name), *every(self.second, name)]

    def __iter__(self) -> Iterator[str]:
        return iter({*self.first, *self.second})

    def __len__(self) -> int:
        return len({*self.first, *self.second})


def every(worth: Mapping[str, Origin], name: str) -> list[Origin]:
    """Return all that a name is worth in some variables, the one that wins first."""
    if isinstance(worth, Both):
        return worth.every(name)
    return [worth[name]] if name in worth else []


def not_for(name: str, source: str, at: Position) -> Diagnostic:
    """Return that a file asks for what stands beside another one, which is the user's, or a stranger's."""
    message = f"the variable {name} is of {source}, beside which this file does not lie, and is not put in"
    hint = f"if it is meant: --env-file {quote(source)}, or --set {name}=VALUE; where all is your own: --root DIR"
    return Diagnostic(at, message, hint=hint, code=Code.COMPOSE_VARIABLE)
