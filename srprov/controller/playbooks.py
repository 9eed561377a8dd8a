"""The playbooks that ship with srprov, and those of the user's own folder. Reads files."""

from __future__ import annotations

from pathlib import Path

from srprov import data
from srprov.definitions.playbook import from_folder
from srprov.definitions.playbookmodel import Playbook


def playbooks() -> dict[str, str]:
    """Return the playbooks that ship with srprov: file name -> text."""
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(data.playbooks_folder().glob("*.yml"))}


def own_playbooks(folder: Path) -> tuple[Playbook, ...]:
    """Return the playbooks of the user's own folder; none when there is no such folder.

    Raises:
        DefinitionError: With everything that is wrong with them.
    """
    return from_folder(str(folder), playbooks()) if folder.is_dir() else ()
