"""A run's files as they are bundled: those of the lab's own without its private words, others as they came.

Takes Files and a Replacer; gives content piece by piece.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from srprov.evidence.files import Files, json_of
from srprov.evidence.private_words import Replacer, without_access, without_user
from srprov.record.folder import in_lines
from srprov.untrusted import string_map

HARDWARE = "hardware.json"
"""What of a session stays at home: which serial number has which token."""
_LONGEST_LINE = 1 << 20


def is_as_it_came(name: str) -> bool:
    """Return whether a file is bundled as it is: results, whose hashes the robots gave, and the experiment's own."""
    parts = name.split("/")
    results = parts[0] == "trials" and len(parts) > 3 and parts[2] == "results"
    inputs = parts[0] == "sessions" and len(parts) > 3 and parts[2] == "inputs" and parts[3:] != ["inventory.yml"]
    return results or inputs


def redacted(files: Files, name: str, replacer: Replacer) -> Iterator[bytes]:
    """Return a file's content without the lab's private words, line by line."""
    end = name.rpartition("/")[2]
    if name.startswith("sessions/") and end in ("facts.json", "inventory.yml"):
        document = json_of(files, name)
        tokens = string_map(json_of(files, f"{'/'.join(name.split('/')[:2])}/{HARDWARE}").get("tokens"))
        some = without_user(document, tokens) if end == "facts.json" else without_access(document)
        yield replacer.text(in_lines(some) + "\n").encode("utf-8", "surrogateescape")
        return
    for line in _lines(files.pieces(name)):
        yield replacer.line(line)


def _lines(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """Return the lines of a file; one that is very long in parts, which are cut where no word is."""
    before = b""
    for piece in pieces:
        *lines, before = (before + piece).split(b"\n")
        yield from (line + b"\n" for line in lines)
        if len(before) > _LONGEST_LINE:
            at = before.rfind(b" ") + 1 or len(before)
            yield before[:at]
            before = before[at:]
    yield before
