"""Where an experiment comes from: the text that tells two experiments of the same name apart.

A git checkout with a remote gives the remote's URL (scheme, host and path) and the path inside, so that every clone of
one repository is the same source. Anything else gives `user@host:path`. Reads `.git/config`, runs nothing.
"""

from __future__ import annotations

import re
from pathlib import Path
from urllib.parse import urlsplit

from srprov import regular_file
from srprov.owner import owner

_LARGEST = 64 * 1024
"""Bytes of git's configuration that are read."""
_MOST_READ = 1024 * 1024
"""Bytes of it in all folders above an EDF: a stranger's project may have one in each."""
_LONGEST_URL = 1024
_SCP = re.compile(r"(?:[^@/]*@)?([A-Za-z0-9._-]+):(?!//)/?(.+)")


def source_of(path: str) -> str:
    """Return the source text of an EDF at an absolute path."""
    here = Path(path).resolve()
    left = _MOST_READ
    for folder in here.parents:
        config = _config(folder / ".git")
        left -= len(config)
        if left < 0:
            break
        if url := _address(_url(config.decode("utf-8", "replace"))):
            return f"{url}#{here.relative_to(folder).as_posix()}"
    return f"{owner()}:{here}"


def _config(git: Path) -> bytes:
    """Return git's configuration, or nothing.

    No link is followed, nor the file that a worktree or submodule has as `.git`, nor is a file with a second name read:
    each may come with a stranger's project, and lead to a repository whose address is nobody's business.
    """
    config = git / "config"
    try:
        if git.is_symlink() or config.is_symlink():
            return b""
        content, about = regular_file.read_with_status(config, _LARGEST)
    except (OSError, ValueError):
        return b""
    return b"" if regular_file.has_further_names(about) else content


def _url(config: str) -> str:
    """Return the last URL of `origin`; nothing where its section has a line that git refuses.

    Line by line: Python's own parser of such files fails at some of them, and takes its time with others.
    """
    url, is_origin = "", False
    for line in map(str.strip, config.split("\n")):
        if not line or line[0] in "#;":
            continue
        if line[0] == "[":
            is_origin = line[1:].rpartition("]")[0] == 'remote "origin"'
        elif is_origin:
            key, _, value = line.partition("=")
            name = key.rstrip().lower()
            if not name.replace("-", "").isalnum():
                return ""
            url = value.lstrip() if name == "url" else url
    return url


def _address(url: str) -> str:
    """Return `scheme://host/path` of a remote: no user, no password, no query; "" for what has no such form."""
    if scp := _SCP.fullmatch(url):
        url = f"ssh://{scp[1]}/{scp[2]}"
    if len(url.encode()) > _LONGEST_URL or not url.isprintable():
        return ""
    try:
        parts = urlsplit(url)
        host = f"[{parts.hostname}]" if ":" in (parts.hostname or "") else parts.hostname
        port = f":{parts.port}" if parts.port else ""
    except ValueError:
        return ""
    # an '@' in the path may be the end of a password with a '/' in it
    return f"{parts.scheme}://{host}{port}{parts.path}" if parts.scheme and host and "@" not in parts.path else ""
