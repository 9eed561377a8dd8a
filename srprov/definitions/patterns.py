"""Ansible's host patterns -> names of hosts.

Takes an Inventory and a pattern such as `robots:!robot3`; gives the hosts that it picks. Reads the files that a pattern
names, and nothing else. Terms are parted by
`,` or `:`; plain terms are joined, then `&term` keeps what is in both, then `!term` takes away, in whatever order
they are written. A term is a host, a group, `all` or `*`, a wildcard, `~regex`, a range `robot[01:04]`, a part of
a group by position, `robots[0]` and `robots[1:3]`, `@failed`, or `@FILE`, a file with one robot per line. The name
`failed` is taken: a file of that name is `@./failed`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Sequence
from shlex import quote

from srprov import regular_file
from srprov.codes import Code
from srprov.definitions.model import Inventory
from srprov.definitions.named_links import refuse_link_out
from srprov.definitions.terms import Terms, TooMuchError
from srprov.errors import UsageError, did_you_mean
from srprov.names import few

_MOST_BYTES = 256 << 10
"""Of a list of robots; the longest inventory has 10,000."""
_MOST_PATTERNS = 200
"""Of a list, but for the names of robots and groups: each is held against all of them."""
FAILED = "@failed"
Failed = Callable[[], Collection[str]]
"""Gives the robots that `@failed` stands for; raises UsageError when there are none."""


def _no_run() -> Collection[str]:
    """Refuse: only who knows an experiment knows its last run."""
    raise UsageError(
        f"'{FAILED}' means the last run of an experiment, and there is none here",
        hint="name the robots",
        code=Code.NO_RUN,
    )


def select(inventory: Inventory, pattern: str | Sequence[str], failed: Failed = _no_run) -> tuple[str, ...]:
    """Return the names that a pattern (or several, joined) picks, in name order.

    Args:
        inventory: Hosts and groups.
        pattern: As the user wrote it.
        failed: What `@failed` stands for; asked only when the pattern has it.

    Raises:
        UsageError: A term matches nothing, or nothing is left; the hint lists hosts and groups.
    """
    text = pattern if isinstance(pattern, str) else ",".join(pattern)
    terms = _terms(text)
    plain = [term for term in terms if term[0] not in "&!"]
    picked: set[str] = set()
    known = Terms(inventory)
    for term in plain or ["all"]:
        picked |= _match(inventory, known, term, failed)
    for term in terms:
        if term.startswith("&"):
            picked &= _match(inventory, known, term[1:], failed)
    for term in terms:
        if term.startswith("!"):
            picked -= _match(inventory, known, term[1:], failed)
    if not picked:
        raise UsageError(f"the pattern '{text}' matches no host", hint=_known(inventory), code=Code.NO_MATCH)
    return tuple(sorted(picked))


def _terms(text: str) -> list[str]:
    """Split at `,` and `:` outside brackets; a regex reaches to the next comma, since it may hold colons."""
    terms: list[str] = []
    for chunk in map(str.strip, re.split(r",(?![^\[]*\])", text)):
        if chunk.lstrip("&!").startswith("~") or _is_ipv6(chunk):
            terms.append(chunk)
        else:
            terms += [term.strip() for term in re.split(r":(?![^\[]*\])", chunk)]
    return [term for term in terms if term.strip("&!")]


def _is_ipv6(text: str) -> bool:
    return text.count(":") > 1 and re.fullmatch(r"[&!]?[0-9a-fA-F:.]+", text) is not None


def _match(inventory: Inventory, known: Terms, term: str, failed: Failed) -> set[str]:
    if term == FAILED:
        return _failed(inventory, failed())
    if term.startswith("@"):
        return _of_file(inventory, term[1:])
    return _found(inventory, known, term)


def _found(inventory: Inventory, known: Terms, term: str) -> set[str]:
    """Return the hosts of one term that names no list.

    Raises:
        UsageError: There are none.
        TooMuchError: It is too much with those before.
    """
    found = known.hosts(term)
    if not found:
        suggestion = did_you_mean(term, [*inventory.hosts, *inventory.groups])
        hint = f"{suggestion} {_known(inventory)}".lstrip()
        raise UsageError(f"'{term[:100]}' matches no host and no group", hint=hint, code=Code.NO_MATCH)
    return found


def _failed(inventory: Inventory, robots: Collection[str]) -> set[str]:
    here = set(robots) & set(inventory.hosts)
    if not here:
        message = f"'{FAILED}' means {', '.join(sorted(robots))}: not in this inventory"
        raise UsageError(message, hint=_known(inventory), code=Code.NO_MATCH)
    return here


def _of_file(inventory: Inventory, name: str) -> set[str]:
    """Return the hosts that a file lists, one term per line; empty lines and `#` lines are passed over.

    One that matches nothing is shown, so a project's link to a file of the user's is not followed, nor a further name.
    """
    lines = _lines(name)
    found: set[str] = set()
    known = Terms(inventory, listed=True)
    left = _MOST_PATTERNS
    for line, number in lines.items():
        if line.startswith("@"):
            raise UsageError(f"'@{name}': a list of robots cannot name another: '{line[:100]}'", code=Code.OPTION_VALUE)
        left -= line not in inventory.hosts and line not in inventory.groups
        if left < 0:
            message = f"'@{name}' has more than {_MOST_PATTERNS} lines that are no names of robots or groups"
            raise UsageError(message, hint="name the robots themselves", code=Code.TOO_LARGE)
        try:
            found |= _found(inventory, known, line)
        except TooMuchError:
            message = f"'@{name}', line {number}: to look for all lines up to this one in this inventory takes too long"
            hint = "name the robots themselves, or write fewer and shorter patterns"
            raise UsageError(message, hint=hint, code=Code.TOO_LARGE) from None
    if not found:
        raise UsageError(f"'@{name}' names no robot", hint=_known(inventory), code=Code.NO_MATCH)
    return found


def _lines(name: str) -> dict[str, int]:
    """Return what a list says, and on which line first."""
    refuse_link_out(name, "@", f"'@{name}': ")
    try:
        content, about = regular_file.read_with_status(name, _MOST_BYTES)
        every = content.decode().split("\n")
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        hint = f"'@FILE' is a file with one robot per line; '{FAILED}' are those that failed in the last run"
        raise UsageError(f"'@{name}': {why}", hint=hint, code=Code.NO_FILE) from None
    if regular_file.has_further_names(about) and not os.path.isabs(name):  # an archive may have given it this one
        hint = f"if you mean it, name its whole path: @{quote(os.path.abspath(name))}"
        raise UsageError(f"'@{name}' has another name (a hard link)", hint=hint, code=Code.STRANGE_FILE)
    lines: dict[str, int] = {}
    for number, line in enumerate(map(str.strip, every), 1):
        if line and not line.startswith("#"):
            lines.setdefault(line, number)
    return lines


def _known(inventory: Inventory) -> str:
    groups = ", ".join(name for name in inventory.groups if name != "ungrouped")
    return f"hosts: {few(list(inventory.hosts), 20) or 'none'}; groups: {groups}"
