"""Words that mean something in a bundle whoever has them for a name: no private word of a robot replaces one of them.

Takes a run's files; gives an answer for each word. A robot chooses what it is called, and says which addresses and
serial number it has. Were one of them `assignment`, a service, the value of a parameter or what an image is called, and
that replaced, the bundle would say of all others what that robot likes: who ran what, and what came of a trial. The
experiment's own files stay as they are, so that a word of theirs hides nothing.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov import data
from srprov.evidence.files import MOST_TEXT, Files, content, json_of, sessions
from srprov.evidence.private_words import replaceable
from srprov.evidence.redacted import HARDWARE
from srprov.image_reference import BUILT
from srprov.untrusted import mapping, string, string_map

_HOST = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_.-]{0,252}[A-Za-z0-9_])?", re.ASCII)
_CONTENT_TAG = re.compile(rf"{re.escape(BUILT)}[a-z0-9._-]{{1,200}}:([0-9a-f]{{32}})(?![0-9a-f])")


class PublicWords:
    """The words of one run."""

    def __init__(self, files: Files) -> None:
        """Take the run's files."""
        own, kinds = list(_texts(files)), data.schema_kinds()
        self._own = "\n".join(own).casefold()
        self._replaceable = replaceable(self._own)
        self._text = "\n".join([*map(data.schema_text, kinds), *own, *_robots(files)])

    def may_hide(self, host: str) -> bool:
        """Return whether a text that a robot says is its name is one that a host can have, and means nothing else."""
        return _HOST.fullmatch(host) is not None and not _stands(host, self._text)

    def stays(self, word: str) -> bool:
        """Return whether a word of any kind is one of the run's own.

        A robot may be called by its address, and srprov's documents name some: those are no reason to show one. An
        address is one of the run's own wherever it would be replaced, as in `10.9.8.7-10.9.8.20`.
        """
        return word.casefold() in self._replaceable or _stands(word.casefold(), self._own)


def _stands(word: str, text: str) -> bool:
    return word in text and re.search(rf"(?<![\w.]){re.escape(word)}(?!\w|[.-]\w)", text) is not None


def _texts(files: Files) -> Iterator[str]:
    """Yield definitions, the names of services, images and columns, and what stands for serial numbers."""
    for home in sessions(files):
        edf = f"{home}/{string(json_of(files, f'{home}/inputs.json').get('edf'))}"
        if edf in files.sizes:
            yield content(files, edf, MOST_TEXT).decode("utf-8", "replace")
        yield from mapping(json_of(files, f"{home}/assignment.json").get("assignment"))
        yield from string_map(json_of(files, f"{home}/{HARDWARE}").get("tokens")).values()
        if (plan := f"{home}/plan.json") in files.sizes:
            yield from _CONTENT_TAG.findall(content(files, plan, files.sizes[plan]).decode("utf-8", "replace"))
    for name in files.sizes:
        if "/" not in name and name.endswith(".csv"):
            yield next(files.pieces(name), b"").partition(b"\n")[0].decode("utf-8", "replace")


def _robots(files: Files) -> Iterator[str]:
    for home in sessions(files):
        yield from mapping(json_of(files, f"{home}/facts.json").get("robots"))
        yield from map(string, mapping(json_of(files, f"{home}/assignment.json").get("assignment")).values())
