r"""Names of instances, services and robots: one rule for each, held wherever a name enters.

Names become folders, file names, containers, host names and words of commands, on robots and here. They enter by user
files, options, plan files and what robots say. Pure. `fullmatch` everywhere: `$` also fits before a last line feed.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from srprov.codes import Code
from srprov.errors import UsageError

RESERVED = frozenset({"localhost", "ip6-localhost", "ip6-loopback", "ip6-allnodes", "ip6-allrouters"})
"""Names that a hosts file gives to other addresses."""

OWN_LABELS, DOCKERS_LABELS = "srprov", ("com.docker", "io.docker", "org.dockerproject")
"""How labels of containers begin by which srprov, or a program of Docker's, knows its own."""

_MOST_BYTES = 200
"""Of a name, which is that of files, too, with an ending each; a file's name has 255 at most."""

_RULES = {
    # it is a word of commands, also of those that an export's script runs, which take `-x` for an option
    "instance": (
        re.compile(r"[a-z0-9][a-z0-9-]{0,31}"),
        "lower-case letters, digits and '-', 32 at most, starting with a letter or digit",
    ),
    # no dot: it enters a hosts file, where `example.com` would take the place of another host
    "service": (
        re.compile(r"[a-z0-9]([a-z0-9_-]{0,61}[a-z0-9])?"),
        "lower-case letters, digits, '_' and '-', 63 at most, starting and ending with a letter or digit",
    ),
    "robot": (
        re.compile(r"\w[\w.:@%+-]{0,199}"),
        "letters, digits and any of . _ - : @ % +, 200 bytes at most, starting with a letter or digit",
    ),
    "site": (
        re.compile(r"[a-z0-9][a-z0-9_-]{0,62}"),
        "lower-case letters, digits, '_' and '-', 63 at most, starting with a letter or digit",
    ),
    "user": (re.compile(r"[a-z_][a-z0-9_.-]{0,31}"), "lower-case letters, digits, '_', '-' and '.', 32 at most"),
}


def fault(kind: str, name: str) -> str:
    """Return what is wrong with the name of an `instance`, `service`, `robot`, its `user` or `site`, or nothing.

    An experiment's name is that of its instance.
    """
    rule, words = _RULES[kind]
    if kind == "service" and name in RESERVED:
        return f"'{name}' already means something in every hosts file"
    is_name = rule.fullmatch(name) and len(name.encode("utf-8", "surrogatepass")) <= _MOST_BYTES
    return "" if is_name else f"{name[:60]!r} cannot be the name of {_article(kind)}: {words}"


def valid(kind: str, name: object) -> bool:
    """Return whether something that a robot or a file says is such a name."""
    return isinstance(name, str) and not fault(kind, name)


def checked(kind: str, name: str, hint: str = "") -> str:
    """Return the name.

    Raises:
        UsageError: It cannot be one.
    """
    if wrong := fault(kind, name):
        raise UsageError(wrong, hint=hint, code=Code.NAME)
    return name


def label_fault(name: str) -> str:
    """Return what is wrong with a label for a container, or nothing."""
    if _begins(name, OWN_LABELS):
        return f"the label '{name[:60]}' is srprov's own"
    taken = any(_begins(name, one) for one in DOCKERS_LABELS)
    return f"the label '{name[:60]}' is one that Docker's own programs go by" if taken else ""


def _begins(name: str, word: str) -> bool:
    return name == word or name.startswith(f"{word}.")


def few(names: Sequence[str], most: int) -> str:
    """Return names for a sentence, such as `a, b and 3 more`: the first ones, and how many are not shown."""
    return ", ".join(names[:most]) + (f" and {len(names) - most} more" if len(names) > most else "")


def _article(kind: str) -> str:
    return f"an {kind}" if kind == "instance" else f"a {kind}"
