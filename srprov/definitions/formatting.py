"""EDFs and CDFs in one form: comments stay, keys of the file and of its services stand in the order of the schema.

Takes paths or text; gives text, and writes nothing. `yamldoc/canonical.py` sees to it that the values stay.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from shlex import quote

import msgspec

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions.paths import inside, link_out
from srprov.definitions.schema import MOST_BYTES, MOST_VALUES
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import loader
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.canonical import canonical
from srprov.yamldoc.nodes import Map

KINDS = ("edf", "cdf")
SUFFIXES = tuple(f".{kind}{more}" for kind in KINDS for more in ("", ".yml", ".yaml"))
"""Of files that are found in a folder."""


class Place(msgspec.Struct, frozen=True):
    """A file that is to be brought into form."""

    path: str
    """As it is called in messages."""
    real: str
    """Without links, as it was when it was looked for: one that others put there since is not followed."""


class Formatted(msgspec.Struct, frozen=True, kw_only=True):
    """A file before and after."""

    path: str
    real: str
    """As its `Place` has them."""
    before: str
    after: str

    @property
    def changed(self) -> bool:
        """Whether it was not in its form."""
        return self.before != self.after


def formatted(place: Place) -> Formatted:
    """Return a file as it is and in its form.

    Raises:
        DefinitionError: It is neither EDF nor CDF, has a further name, or cannot be read or brought into form.
    """
    path = place.path
    _check_one_name(place)
    kind = _kind(place)
    if not kind:
        problem = Diagnostic(
            Location(path), "is neither an EDF nor a CDF", hint="name it .edf or .cdf", code=Code.WRONG_KIND
        )
        raise DefinitionError([problem])
    text = loader.read_text(place.real, path, MOST_BYTES, real=True)
    return Formatted(path=path, real=place.real, before=text, after=_text(text, path, kind))


def _check_one_name(place: Place) -> None:
    """Refuse a file with a further name: the one here would become a file of its own, with what the other one holds.

    An archive may have given any file of the user's that name. What is made of it here, nobody would know again.
    """
    with contextlib.suppress(OSError, ValueError):  # who reads it says so
        if regular_file.has_further_names(os.lstat(place.real)):
            hint = "copy it, if it is the experiment's"
            why = "has another name (a hard link), and is not read"
            raise DefinitionError([Diagnostic(Location(place.path), why, hint=hint, code=Code.IN_THE_WAY)])


def _kind(place: Place) -> str:
    """Return `edf` or `cdf`, by the name or by a key of that name, or nothing: a Compose file is no EDF."""
    from srprov.definitions.dockerfile import is_dockerfile

    path = place.path
    named = next((suffix[1:4] for suffix in SUFFIXES if path.endswith(suffix)), "")
    if named or is_dockerfile(path):
        return named
    root = loader.parse(loader.read_text(place.real, path, MOST_BYTES, real=True), path)
    return next((kind for kind in KINDS if isinstance(root, Map) and kind in root.entries), "")


def formatted_text(text: str, name: str) -> str:
    """Return the text of an EDF or CDF in its form; its keys tell which of them it is.

    Raises:
        DefinitionError: It is no YAML, or cannot be brought into form.
    """
    root = loader.parse(text, name)
    return _text(text, name, "cdf" if isinstance(root, Map) and "cdf" in root.entries else "edf")


def _text(text: str, name: str, kind: str) -> str:
    from srprov.data import schema

    with allowance(MOST_BYTES, MOST_VALUES):  # what is more is no experiment's, and takes long
        loader.parse(text, name)
    top = tuple(schema(kind)["properties"])
    services = schema("edf")["properties"]["services"]["additionalProperties"]["properties"]
    service = tuple(services) if kind == "edf" else ()

    def orders(path: Sequence[str]) -> Sequence[str]:
        return top if not path else service if len(path) == 2 and path[0] == "services" else ()

    return canonical(text, name, orders)


def definition_files(paths: Sequence[str]) -> Iterator[Place]:
    """Yield files that are named, and those of folders that are named, by their suffix.

    Hidden folders are left out, and so are links in a folder: they may lead out of it.

    Raises:
        DefinitionError: A path is a link; whoever wants its file named it would find the link gone. Or a link in it
            leads elsewhere: with a project that was cloned, to files of the user's.
    """
    for path in paths:
        folder, name = os.path.split(path)
        real = os.path.realpath(path) if os.path.isdir(path) else os.path.join(os.path.realpath(folder), name)
        why = "is a link, which would be replaced by a file" if os.path.islink(path) and not os.path.isdir(path) else ""
        if why or link_out(path) or _is_elsewhere(path, real):
            why = why or "a link in it leads out of its folder, and nothing is written by way of it"
            hint = f"name the file itself: {quote(os.path.realpath(path))}"
            raise DefinitionError([Diagnostic(Location(path), why, hint=hint, code=Code.IN_THE_WAY)])
        if not os.path.isdir(real):
            yield Place(path, real)
            continue
        for folder, folders, names in regular_file.walk(real):
            folders[:] = sorted(one for one in folders if not one.startswith("."))
            files = [os.path.join(folder, one) for one in sorted(names) if one.endswith(SUFFIXES)]
            shown = [str(Path(path, os.path.relpath(one, real))) for one in files]
            yield from (Place(*one) for one in zip(shown, files, strict=True) if not os.path.islink(one[1]))


def _is_elsewhere(path: str, real: str) -> bool:
    """Return whether a relative path led out of the folder where it begins, by a link that is gone when it is judged.

    What goes up again behind a name is left to `link_out`.
    """
    parts = path.split("/")
    up = next((count for count, part in enumerate(parts) if part not in ("", ".", "..")), len(parts))
    return not os.path.isabs(path) and ".." not in parts[up:] and not inside(real, "/".join(parts[:up]) or ".")
