"""EDFs and CDFs in one form: comments stay, keys of the file and of its services stand in the order of the schema.

Takes paths or text; gives text, and writes nothing. `yamldoc/canonical.py` sees to it that the values stay.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from shlex import quote

import msgspec

from srprov import own_records, regular_file
from srprov.codes import Code
from srprov.definitions.files_below import below, kind_by_name
from srprov.definitions.paths import inside
from srprov.definitions.schema import MOST_BYTES, MOST_VALUES
from srprov.errors import DefinitionError, Diagnostic, Location
from srprov.yamldoc import loader
from srprov.yamldoc.allowance import allowance
from srprov.yamldoc.canonical import canonical
from srprov.yamldoc.nodes import Map

KINDS = ("edf", "cdf")
MOST_LINES = 100_000
"""Of a file: where comments and empty lines go is decided one by one."""


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
    text = _read(place)
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
    named = kind_by_name(path)
    if named or is_dockerfile(path):
        return named
    root = loader.parse(_read(place), path)
    return next((kind for kind in KINDS if isinstance(root, Map) and kind in root.entries), "")


def _read(place: Place) -> str:
    text = loader.read_text(place.real, place.path, MOST_BYTES, real=True)
    _check_lines(text, place.path)
    return text


def _check_lines(text: str, name: str) -> None:
    if text.count("\n") + text.count("\r") - text.count("\r\n") > MOST_LINES:
        why = f"has more than {MOST_LINES} lines, and is left as it is"
        raise DefinitionError([Diagnostic(Location(name), why, code=Code.TOO_LARGE)])


def formatted_text(text: str, name: str) -> str:
    """Return the text of an EDF or CDF in its form; its keys tell which of them it is.

    Raises:
        DefinitionError: It is no YAML, has too many lines, or cannot be brought into form.
    """
    _check_lines(text, name)
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


def definition_files(paths: Sequence[str], leave: Callable[[str, str], None]) -> Iterator[Place]:
    """Yield files that are named, and of folders that are named those that `validate` takes, but for links.

    Args:
        paths: Files and folders.
        leave: Is told what is left as it is, and why: links in a folder, and what lies in a record.

    Raises:
        DefinitionError: A path is a link; whoever wants its file named it would find the link gone. Or there is one in
            it, also one that stays inside: it came with a project that was cloned or unpacked, perhaps in the home.
        UsageError: A folder holds more than anybody means.
    """
    for path in paths:
        folder, name = os.path.split(path)
        real = os.path.realpath(path) if os.path.isdir(path) else os.path.join(os.path.realpath(folder), name)
        why = "is a link, which would be replaced by a file" if os.path.islink(path) and not os.path.isdir(path) else ""
        if why or _by_a_link(path) or _is_elsewhere(path, real):
            why = why or "a link leads there, and nothing is written by way of it"
            hint = f"name the file itself: {quote(os.path.realpath(path))}"
            raise DefinitionError([Diagnostic(Location(path), why, hint=hint, code=Code.IN_THE_WAY)])
        if own_records.record_of(real):
            leave(path, "it lies in a record of srprov's own")
            continue
        for file in below(real) if os.path.isdir(real) else [real]:
            shown = path if file == real else str(Path(path, os.path.relpath(file, real)))
            if os.path.islink(file):
                leave(shown, "it is a link")
            else:
                yield Place(shown, file)


def _by_a_link(path: str) -> bool:
    """Return whether a path is a link to a folder, or a relative one has a link in it."""
    return any(regular_file.links_in(path)) or os.path.islink(os.path.normpath(path))


def _is_elsewhere(path: str, real: str) -> bool:
    """Return whether a relative path led out of the folder where it begins, by a link that is gone when it is judged.

    What goes up again behind a name is left to `links_in`.
    """
    parts = path.split("/")
    up = next((count for count, part in enumerate(parts) if part not in ("", ".", "..")), len(parts))
    return not os.path.isabs(path) and ".." not in parts[up:] and not inside(real, "/".join(parts[:up]) or ".")
