"""What describes a bundle, for people and for programs: which files there are, and of what each is made.

Takes a Story and the files that it was read from; gives contents. They follow from the run alone, so `verify` makes
them again.
"""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Iterator, Mapping

from srprov.evidence import checklist, citation, crate, deposits, papers
from srprov.evidence.crate_base import Told
from srprov.evidence.crate_images import of_services
from srprov.evidence.files import ABOUT, CRATE, MANIFEST, SIGNATURE, Files, content, json_of
from srprov.evidence.session import data_sets
from srprov.evidence.story import Story

RULES = 4
"""Raised whenever one of these says something else of the same run: bundles of other rules are not held to these. A
test of a bundle that is published fails where that was forgotten."""
_MOST_OWN = 8 << 20
_WRITERS: Mapping[str, Callable[[Told], bytes]] = {
    "README.md": lambda told: papers.readme(told).encode("utf-8", "replace"),
    citation.CITATION: citation.citation,
    citation.LICENSE: citation.license_text,
    deposits.ZENODO: deposits.zenodo,
    deposits.DATACITE: deposits.datacite,
    checklist.NAME: checklist.text,
    CRATE: lambda told: crate.text(told).encode("utf-8", "replace"),
}
"""In this order: the crate lists all others."""
GENERATED = frozenset(_WRITERS)
NOT_LISTED = frozenset({CRATE, MANIFEST, SIGNATURE})
"""What the crate does not list: itself, and what is made after it."""


def told_of(files: Files, story: Story, hashes: Mapping[str, tuple[int, str]]) -> Told:
    """Return what descriptions are made of.

    Args:
        files: The run's, or a bundle's.
        story: What was read from them.
        hashes: Name -> size and sha256 of each file but NOT_LISTED; descriptions may come as they are written.

    Raises:
        NotThere: Something is missing, or is not what a run writes.
    """
    folder = posixpath.dirname(story.edf)
    beside = {name: f"{folder}/{name}" for name in (*citation.LICENSES, citation.CITATION)}
    return Told(
        story=story,
        facts=json_of(files, f"{story.home}/facts.json"),
        environment=json_of(files, f"{story.home}/environment.json"),
        inventory=json_of(files, f"{story.home}/inputs/inventory.yml"),
        own={name: content(files, path, _MOST_OWN) for name, path in beside.items() if path in files.sizes},
        size=sum(size for name, (size, _) in hashes.items() if name not in GENERATED and name != ABOUT),
        data_sets=tuple(sorted(data_sets(files, story.home))),
        files=hashes,
        images=of_services(story, files),
    )


def written(told: Told) -> Iterator[tuple[str, bytes]]:
    """Return name and content of each description. Each must be in `told.files` before the next one is asked for."""
    for name, write in _WRITERS.items():
        yield name, write(told)
