"""Where an experiment comes from: the text that tells two experiments of the same name apart.

A git checkout with a remote gives the remote's URL (without credentials) and the path inside, so that every clone
of one repository is the same source. Anything else gives `user@host:path`. Reads `.git/config`, runs nothing.
"""

from __future__ import annotations

import configparser
import re
from pathlib import Path

from srprov.owner import owner


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
    if git.is_file():
        target = git.read_text(encoding="utf-8", errors="replace").removeprefix("gitdir:").strip()
        git = (git.parent / target).resolve()
        common = git / "commondir"
        if common.is_file():
            git = (git / common.read_text(encoding="utf-8").strip()).resolve()
    config = git / "config"
    if not config.is_file():
        return ""
    parser = configparser.RawConfigParser(strict=False, allow_no_value=True)
    try:
        parser.read_string(config.read_text(encoding="utf-8", errors="replace"))
    except configparser.Error:
        return ""
    url = parser.get('remote "origin"', "url", fallback="") or ""
    return re.sub(r"(?<=://)[^/@]*@", "", url)
