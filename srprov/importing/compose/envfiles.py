"""Files of variables -> what variables are worth, and what `env_file` adds to a service. Reads files."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Mapping, Sequence

from srprov.codes import Code
from srprov.errors import Diagnostic
from srprov.importing.compose import dotenv
from srprov.importing.compose.loading import File
from srprov.importing.compose.origins import Origin
from srprov.importing.compose.source import Reading
from srprov.importing.compose.variables import Variables
from srprov.importing.normal import Refused
from srprov.importing.position import Position


def variables(files: Sequence[File], reading: Reading, known: Variables) -> dict[str, Origin]:
    """Return what files of variables say; of names that several give, the last counts.

    Raises:
        Refused: A file cannot be read, is none of variables, or asks for a variable that has no value.
    """
    found: dict[str, Origin] = {}
    for file in files:
        text = reading.variables(file.path, file.shown, file.named)
        own = values(text, file.shown, known, found)
        found |= {name: Origin(value, file.shown) for name, (value, _) in own.items()}
    if known.problems:
        raise Refused(known.problems)
    return {name: origin for name, origin in found.items() if not name[:1].isdigit()}


def values(
    text: str, shown: str, known: Variables, found: Mapping[str, Origin] | None = None, *, raw: bool = False
) -> dict[str, tuple[str, Position]]:
    """Return the values of one file, with the line of each.

    `known` wins over the file for what its values ask for; `found` is what files before it said.
    """
    own: dict[str, Origin] = {}
    scope = known.beside(ChainMap(own, dict(found or {})))

    def lookup(name: str, at: Position) -> str | None:
        origin = scope.worth.get(name)
        known.record(name, origin.source if origin else "unset", origin.value if origin else "", at)
        return origin.value if origin else None

    result = {}
    for entry in dotenv.raw(text, shown, lookup) if raw else dotenv.read(text, shown, scope.put_in, lookup):
        if entry.value is not None:
            own[entry.name] = Origin(entry.value, shown)
            result[entry.name] = (entry.value, entry.at)
    return result


def missing(file: File) -> Refused:
    """Return the refusal of a file of variables that is not there."""
    place = file.named.at if file.named else Position(file.shown)
    return Refused([Diagnostic(place, f"there is no file of variables '{file.shown}'", code=Code.COMPOSE_VARIABLE)])
