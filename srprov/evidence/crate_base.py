"""What all parts of a crate are made with: what is told, identifiers and references. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import quote

import msgspec

from srprov.evidence.story import Story
from srprov.oci.layout import Stored
from srprov.untrusted import string

Entity = dict[str, Any]
MOST_LISTED = 2000
"""Files that are listed one by one; with more, those of trials are not, since the manifest names every file."""
_MARKS = re.compile(r"[\\`*\[\]<>|]")


class Told(msgspec.Struct, frozen=True, kw_only=True):
    """What the crate is made of."""

    story: Story
    facts: Mapping[str, Any]
    """`facts.json` of the last session."""
    environment: Mapping[str, Any]
    files: Mapping[str, tuple[int, str]]
    """Name -> size and sha256, of all but the crate itself, the manifest and its signature."""
    inventory: Mapping[str, Any] = msgspec.field(default_factory=dict)
    """`inputs/inventory.yml` of the last session."""
    own: Mapping[str, bytes] = msgspec.field(default_factory=dict)
    """What lies beside the EDF for readers, such as LICENSE: name -> content."""
    size: int = 0
    """Bytes of the bundle's files but for what describes it."""
    data_sets: tuple[str, ...] = ()
    """Their places below the inputs; they are not in the bundle."""
    images: Mapping[str, Stored] = msgspec.field(default_factory=dict)
    """Service -> its image, where that is in the bundle."""


def ref(name: str) -> Entity:
    """Return a reference to an entity."""
    return {"@id": name}


def refs(names: Iterable[str]) -> list[Entity]:
    """Return references to entities."""
    return [ref(name) for name in names]


def file_id(name: str) -> str:
    """Return a file's identifier: its path, with what no URI has as `%XX`."""
    return quote(name, safe="/!$&'()*+,;=@-._~")


def of_robot(text: object) -> str:
    """Return what a robot says of itself without what would be a link, a picture, HTML or a cell in Markdown.

    No honest robot has such a mark there, so the same run is described as before.
    """
    return _MARKS.sub("/", string(text))


def utc(text: object) -> str:
    """Return a time of the journal as the profiles want it; nothing when it is none."""
    said = string(text)
    return said if said.endswith("+00:00") and len(said) < 40 else ""


def listed_files(files: Mapping[str, tuple[int, str]]) -> list[str]:
    """Return the files that the crate lists: all, or with very many those outside of the trials' folders."""
    return [name for name in sorted(files) if len(files) <= MOST_LISTED or not name.startswith("trials/")]


def ended_utc(story: Story) -> str:
    """Return when the run's last event was."""
    return next(
        (found for one in reversed(story.events) if (found := utc(one.get("utc")))), "1970-01-01T00:00:00+00:00"
    )


def author_ids(story: Story) -> list[str]:
    """Return the identifiers of the experiment's authors; of the user, where it names none."""
    names = story.definitions.experiment.authors
    return [f"#author-{number}" for number, _ in enumerate(names, start=1)] or ["#user"]


def output_id(service: str, path: str) -> str:
    """Return the identifier of a result."""
    return f"#output-{service}{file_id(path).replace('/', '-')}"


def robot_id(name: str) -> str:
    """Return the identifier of a robot."""
    return f"#robot-{file_id(name)}"


def image_id(service: str) -> str:
    """Return the identifier of a service's image."""
    return f"#image-{file_id(service)}"
