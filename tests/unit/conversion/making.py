"""Projects in normal form, as the reader of Compose files gives them, made of plain values for tests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from srprov.conversion.experiment import Draft, convert
from srprov.conversion.project import Choices, Machine
from srprov.errors import Location
from srprov.importing.normal import Normal

FILE = "compose.yaml"


def normal(document: Mapping[str, Any], file: str = FILE) -> Normal:
    """Give a project whose every value has a line of its own in a file."""
    places: dict[tuple[str | int, ...], Location] = {}

    def walk(value: object, path: tuple[str | int, ...]) -> None:
        places[path] = Location(file, len(places) + 1, 1)
        inner = value.items() if isinstance(value, Mapping) else enumerate(value) if isinstance(value, list) else ()
        for key, one in inner:
            walk(one, (*path, key))

    walk(document, ())
    return Normal(document, places)


def project(services: Mapping[str, Any], **more: Any) -> dict[str, Any]:
    """Give a project's normal form."""
    return {"name": "lab", "services": dict(services), **more}


def draft(
    document: Mapping[str, Any], folder: Path, *, home: str = "robot", robot: str = "", out: str = "out"
) -> Draft:
    """Give the draft of one project whose file lies in a folder."""
    machine = Machine(normal(document, str(folder / FILE)), (str(folder.resolve()),), robot)
    return convert([machine], "lab", Choices(home=home), str(folder / out))


def said(found: Draft, service: str = "a") -> list[str]:
    """Give `class key: message (hint)` of what is not kept as it is of a service, in order."""
    start = f"services.{service}."
    return [
        f"{one.kept.value} {one.key.removeprefix(start)}: {one.message} {one.hint}"
        for one in found.findings
        if one.kept.value != "exact" and one.key.startswith(start)
    ]


def agree(found: Sequence[str], wanted: Sequence[str]) -> list[str]:
    """Give what of two lists does not fit: each wanted one is the beginning, and a part, of one that was found."""
    left = list(found)
    for one in wanted:
        head, _, part = one.partition(": ")
        fitting = next((each for each in left if each.startswith(f"{head}:") and part in each), None)
        if fitting is None:
            return [f"missing: {one}", *left]
        left.remove(fitting)
    return left
