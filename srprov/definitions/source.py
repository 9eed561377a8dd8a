"""Where an experiment comes from: the text that tells two experiments of the same name apart.

A git checkout with a remote gives the remote's URL (without credentials) and the path inside, so that every clone
of one repository is the same source. Anything else gives `user@host:path`. Reads `.git/config`, runs nothing.
"""

from __future__ import annotations

import configparser
import re
from pathlib import Path

from srprov import regular_file
from srprov.owner import owner

_LARGEST = 64 * 1024
"""Bytes of a file of git's that is read."""


def source_of(path: str) -> str:
    """Return the source text of an EDF at an absolute path."""
    here = Path(path).resolve()
    for folder in here.parents:
        url = _remote(folder / ".git")
        if url:
            return f"{url}#{here.relative_to(folder).as_posix()}"
    return f"{owner()}:{here}"


def _remote(git: Path) -> str:
    """Return the URL of `origin`; a worktree's `.git` is a file that names the real folder."""
    parser = configparser.RawConfigParser(strict=False, allow_no_value=True)
    try:
        if git.is_file():
            git = (git.parent / _text(git).removeprefix("gitdir:").strip()).resolve()
            if (git / "commondir").is_file():
                git = (git / _text(git / "commondir").strip()).resolve()
        parser.read_string(_text(git / "config"))
    except (OSError, ValueError, RuntimeError, configparser.Error):  # RuntimeError: links that lead in a circle
        return ""
    url = parser.get('remote "origin"', "url", fallback="") or ""
    return re.sub(r"(?<=://)[^/@]*@", "", url)


def _text(path: Path) -> str:
    return regular_file.read_text(path, _LARGEST, "replace")
