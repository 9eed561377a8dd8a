"""`ansible_ssh_common_args` and its kin -> OpenSSH options.

Takes the text of ssh's own command-line arguments; gives (name, value) pairs with names in lower case, in order, the
first of a name being the one that counts for ssh. Pure.
"""

from __future__ import annotations

import re

from srprov.definitions.unseen import blank
from srprov.definitions.words import split

_WITHOUT_EFFECT = set("46AaCfGgKkMNnqsTtVvXxYy")
"""Flags that change nothing for srprov's connections: compression, verbosity, terminals, forwarding."""

_LONGEST = 10_000
_COMMENT = re.compile(r"""(?:^|[\s'"])#""")
_OF_HOST_KEYS = ("userknownhostsfile", "globalknownhostsfile")
_BEGINS = (";", "|", "&", "(")
_WORDS = re.compile(r"""[;|&(]|[^\s'";|&()<>]+""")
_BELOW_HERE = re.compile(r"(?:.*[:=,])?\.\.?/")
_ASSIGNS = re.compile(r"[A-Za-z_][A-Za-z0-9_]*=")
_RUNS_A_FILE = re.compile(r"(?:\S*/)?(?:\.|source|env|exec|(?:ba|da|z|k)?sh|python[0-9.]*|perl|ruby|node)")
_WHOLE = ("/", "~", "%d", "${")
_OPTIONS = {"J": "proxyjump", "i": "identityfile", "l": "user", "p": "port", "c": "ciphers", "m": "macs"}


def parse(text: str) -> list[tuple[str, str]]:
    """Read ssh's arguments.

    Raises:
        ValueError: They cannot be split into words, or hold an argument that srprov does not honour.
    """
    if len(text) > _LONGEST:
        raise ValueError(f"ssh's arguments are longer than {_LONGEST} characters")
    if _COMMENT.search(blank(text)):  # what stands behind it is taken for a comment by who looks at it
        raise ValueError("ssh's arguments have a '#', which begins no comment there")
    try:
        words = split(text)
    except ValueError as error:
        raise ValueError(f"ssh's arguments cannot be split into words: {str(error).lower()}") from None
    if any(not word.isprintable() for word in words):  # each line would be a setting of its own
        raise ValueError("an argument for ssh has a line end, or another control character")
    options: list[tuple[str, str]] = []
    rest = iter(words)
    for word in rest:
        if not word.startswith("-") or len(word) < 2:
            raise ValueError(f"'{word[:60]}' is not one of ssh's options")
        flags = word[1:]
        while flags and flags[0] in _WITHOUT_EFFECT:
            flags = flags[1:]
        if not flags:
            continue
        value = flags[1:] or next(rest, "")
        if flags[0] == "o":
            options.append(_named(value))
        elif flags[0] in _OPTIONS and value:
            options.append((_OPTIONS[flags[0]], value))
        else:
            raise ValueError(f"ssh's option '-{flags[0]}' is not honoured; -o, -p, -i, -J and -l are")
    return options


def _runs_what_lies_here(command: str) -> bool:
    """Return whether a command runs a program by a relative path, or has a shell or an interpreter run a script."""
    begins, script = True, False
    for word in _WORDS.findall(command):
        if _BELOW_HERE.match(word):
            return True  # of whatever program: `timeout 30 ./jump.sh`, `socat - EXEC:./jump.sh`
        if word in _BEGINS:
            begins, script = True, False
        elif begins and _RUNS_A_FILE.fullmatch(word):
            script = word not in ("exec", "env")
        elif begins and not word.startswith("-") and not _ASSIGNS.match(word):
            if not word.startswith(("/", "~", "$", "%d")) and (script or "/" in word):
                return True
            begins = False
        elif begins and script and word == "-c":
            script = False  # a command is next
    return False


def _named(option: str) -> tuple[str, str]:
    """Split `Name=value` or `Name value`, as ssh_config does."""
    name, sign, value = option.strip().partition("=")
    if not sign or " " in name.strip():
        name, _, value = option.strip().partition(" ")
    name, value = name.strip(), value.strip().lstrip("= ").strip()
    if not name or not value:
        raise ValueError(f"'-o {option[:60]}' is not Name=value")
    lower = name.lower()
    if lower == "proxycommand" and _runs_what_lies_here(value):
        here = f"'{name[:60]} {value[:60]}' runs a file of whatever folder srprov runs in"
        raise ValueError(f"{here}; name it whole, such as {{{{ inventory_dir }}}}/jump.sh")
    if lower in _OF_HOST_KEYS and any(not one.startswith(_WHOLE) and one.lower() != "none" for one in split(value)):
        # a project that was cloned has one: it would decide which host is believed to be a robot
        here = f"'{name[:60]} {value[:60]}' is a file of whatever folder srprov runs in"
        raise ValueError(f"{here}; name it whole, such as {{{{ inventory_dir }}}}/known_hosts")
    return lower, value
