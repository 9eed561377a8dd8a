"""Compose files -> one normal project, or everything that is wrong with them.

Takes paths and the user's choices; gives a `Normal`. Reads the files and what they name in the same folders.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from srprov.importing.normal import Normal


def normalise(
    files: Sequence[Path],
    *,
    profiles: Sequence[str] = (),
    env_files: Sequence[Path] = (),
    settings: Mapping[str, str] | None = None,
    project: str | None = None,
) -> Normal:
    """Read a Compose project as Docker Compose would, but for the environment, which is never looked at.

    Args:
        files: Compose files; later ones override earlier ones.
        profiles: Names of the profiles that are on; `*` is all of them.
        env_files: Files with variables; without any, `.env` beside the first file.
        settings: Variables of the command line; they win over those of files.
        project: The project's name; without it, `name:` of the files, else the name of the first file's folder.

    Raises:
        Refused: With every problem that was found, each with its place.
    """
    raise NotImplementedError
