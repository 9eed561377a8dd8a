"""The value that a user's playbook becomes: its text, and what can be known of it before it is rendered."""

from __future__ import annotations

import os

import msgspec

from srprov.yamldoc.nodes import Source

BEFORE, AFTER, ADDED, REPLACES = "before", "after", "added", "replaces"
"""Where a playbook stands: the first two come with an EDF, the others lie in the user's own folder."""


class PlaybookCommand(msgspec.Struct, frozen=True, kw_only=True):
    """One `command` of a playbook, as it is written there."""

    line: int
    what: str
    """What it runs, and its check."""


class Playbook(msgspec.Struct, frozen=True, kw_only=True):
    """One playbook that a user wrote, checked as far as that is possible without a robot."""

    name: str
    """As plans show it: the path in the EDF, or the file's name in the user's folder."""
    file: str
    """Absolute path."""
    source: Source
    """Its name for problems, and its lines."""
    place: str
    """`before`, `after`, `added` or `replaces`."""
    text: str
    marked: str
    """The text with the place of each key in it, so that what it renders to knows where it comes from."""
    commands: tuple[PlaybookCommand, ...] = ()

    @property
    def foreign(self) -> bool:
        """Return whether it came with the experiment, and not from the user's own folder."""
        return self.place in (BEFORE, AFTER)

    @property
    def base(self) -> str:
        """Its file's name, by which playbooks of the user's folder stand in order."""
        return os.path.basename(self.file)
