"""Words that mean something in a bundle whoever has them for a name: no robot's name for itself replaces one of them.

Takes a run's files; gives an answer for each word. A robot chooses what it is called. Were it `assignment`, or as a
service, and that replaced by the robot's name, the bundle would say of all others what that robot likes: who ran what,
and what came of a trial. The experiment's own files stay as they are, so that a word of theirs hides nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov import data
from srprov.evidence.files import MOST_TEXT, Files, content, json_of, sessions
from srprov.untrusted import mapping, string

_HOST = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_.-]{0,252}[A-Za-z0-9_])?", re.ASCII)


class PublicWords:
    """The words of one run."""

    def __init__(self, files: Files) -> None:
        """Take the run's files."""
        self._text = "\n".join([*map(data.schema_text, data.schema_kinds()), *_texts(files)])

    def may_hide(self, host: str) -> bool:
        """Return whether a text that a robot says is its name is one that a host can have, and means nothing else."""
        if not _HOST.fullmatch(host):
            return False
        return host not in self._text or re.search(rf"(?<![\w.]){re.escape(host)}(?!\w|[.-]\w)", self._text) is None


def _texts(files: Files) -> Iterator[str]:
    """Yield definitions, the names of robots and services, and those of columns."""
    for home in sessions(files):
        edf = f"{home}/{string(json_of(files, f'{home}/inputs.json').get('edf'))}"
        if edf in files.sizes:
            yield content(files, edf, MOST_TEXT).decode("utf-8", "replace")
        yield from mapping(json_of(files, f"{home}/facts.json").get("robots"))
        for service, robot in mapping(json_of(files, f"{home}/assignment.json").get("assignment")).items():
            yield f"{service}\n{string(robot)}"
    for name in files.sizes:
        if "/" not in name and name.endswith(".csv"):
            yield next(files.pieces(name), b"").partition(b"\n")[0].decode("utf-8", "replace")
