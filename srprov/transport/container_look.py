"""What is at paths in a folder of a robot: the question, and how its answer is read. Pure."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Iterable, Mapping

import msgspec

from srprov.untrusted import LONGEST_PATH
from srprov.wire import quote


class Found(msgspec.Struct, frozen=True):
    """What is at a path."""

    kind: str
    """As `find` says it: f, d, l and others."""
    size: int = 0
    link: str = ""


LOOK = """xargs -0 sh -c 'find "$@" -prune -printf "%p\\0%y %s\\0%l\\0"' sh 2>/dev/null | base64 -w 0"""
"""Asks what is at paths below where one is, which come as `told` has them; follows no link at the end of one."""


def told(names: Iterable[str], script: str) -> str:
    """Return a script that gives another one names: they may be more than the words of a program can be."""
    return f"printf '%s\\0' {' '.join(map(quote, names))} | ( {script} )"


def looked(said: str) -> Mapping[str, Found]:
    """Return path -> what is there, by what a robot answers to that."""
    words, found = decoded(said).split(b"\0"), dict[str, Found]()
    for name, about_it, link in zip(words[::3], words[1::3], words[2::3], strict=False):
        kind, _, size = about_it.decode("ascii", "replace").partition(" ")
        if kind and len(link) <= LONGEST_PATH:
            found[text_of(name)] = Found(kind, int(size[:18]) if size.isdecimal() else 0, text_of(link))
    return found


def decoded(said: str) -> bytes:
    """Return the bytes that a robot says in letters, as names may be any bytes; nothing when it says something else."""
    try:
        return base64.b64decode(said.strip(), validate=True)
    except (binascii.Error, ValueError):
        return b""


def text_of(name: bytes) -> str:
    """Return a name as Python has those of files."""
    return name.decode("utf-8", "surrogateescape")
