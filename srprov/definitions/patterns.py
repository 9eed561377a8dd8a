"""Ansible's host patterns -> names of hosts.

Takes an Inventory and a pattern such as `robots:!robot3`; gives the hosts that it picks. Reads the files that a pattern
names, and nothing else. Terms are parted by
`,` or `:`; plain terms are joined, then `&term` keeps what is in both, then `!term` takes away, in whatever order
they are written. A term is a host, a group, `all` or `*`, a wildcard, `~regex`, a range `robot[01:04]`, a part of
a group by position, `robots[0]` and `robots[1:3]`, `@failed`, or `@FILE`, a file with one robot per line. The name
`failed` is taken: a file of that name is `@./failed`.
"""

from __future__ import annotations

import fnmatch
import os
import re
from collections.abc import Callable, Collection, Sequence
from shlex import quote
from typing import Any

from srprov import linear_regex, regular_file
from srprov.codes import Code
from srprov.definitions import ranges
from srprov.definitions.model import Inventory
from srprov.definitions.named_links import refuse_link_out
from srprov.errors import UsageError, did_you_mean
from srprov.names import few

_SUBSCRIPT = re.compile(r"(?P<name>.+)\[(?:(?P<one>-?[0-9]+)|(?P<first>[0-9]*)[:-](?P<last>[0-9]*))\]", re.ASCII)

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
    for term in plain or ["all"]:
        picked |= _match(inventory, term, failed)
    for term in terms:
        if term.startswith("&"):
            picked &= _match(inventory, term[1:], failed)
    for term in terms:
        if term.startswith("!"):
            picked -= _match(inventory, term[1:], failed)
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


def _match(
    inventory: Inventory, term: str, failed: Failed = _no_run, compiled: Callable[[str], Any] = re.compile
) -> set[str]:
    """Return the hosts of one term without its sign.

    Raises:
        UsageError: There are none.
    """
    if term == FAILED:
        return _failed(inventory, failed())
    if term.startswith("@"):
        return _of_file(inventory, term[1:])
    found = _find(inventory, term, compiled)
    if not found:
        suggestion = did_you_mean(term, [*inventory.hosts, *inventory.groups])
        hint = f"{suggestion} {_known(inventory)}".lstrip()
        raise UsageError(f"'{term[:100]}' matches no host and no group", hint=hint, code=Code.NO_MATCH)
    return set(found)


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
    refuse_link_out(name, "@", f"'@{name}': ")
    try:
        content, about = regular_file.read_with_status(name, _MOST_BYTES)
        lines = dict.fromkeys(line.strip() for line in content.decode().split("\n"))
    except (OSError, UnicodeDecodeError) as error:
        why = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        hint = f"'@FILE' is a file with one robot per line; '{FAILED}' are those that failed in the last run"
        raise UsageError(f"'@{name}': {why}", hint=hint, code=Code.NO_FILE) from None
    if regular_file.has_further_names(about) and not os.path.isabs(name):  # an archive may have given it this one
        hint = f"if you mean it, name its whole path: @{quote(os.path.abspath(name))}"
        raise UsageError(f"'@{name}' has another name (a hard link)", hint=hint, code=Code.STRANGE_FILE)
    found: set[str] = set()
    checked = linear_regex.Patterns()  # they may be a stranger's
    left = _MOST_PATTERNS
    for line in lines:
        if line and line[0] not in "#@":
            left -= line not in inventory.hosts and line not in inventory.groups
            if left < 0:
                message = f"'@{name}' has more than {_MOST_PATTERNS} lines that are no names of robots or groups"
                raise UsageError(message, hint="name the robots themselves", code=Code.TOO_LARGE)
            found |= _match(inventory, line, compiled=checked.compiled)
        elif line.startswith("@"):
            raise UsageError(f"'@{name}': a list of robots cannot name another: '{line[:100]}'", code=Code.OPTION_VALUE)
    if not found:
        raise UsageError(f"'@{name}' names no robot", hint=_known(inventory), code=Code.NO_MATCH)
    return found


def _find(inventory: Inventory, term: str, compiled: Callable[[str], Any]) -> list[str]:
    if term.startswith("~"):
        try:
            regex = compiled(term[1:])
        except (re.error, ValueError) as error:
            raise UsageError(f"'{term[1:]}' is not a regular expression: {error}", code=Code.OPTION_VALUE) from None
        return _named(inventory, lambda name: regex.match(name) is not None)
    direct = _wildcard(inventory, term)
    if direct:
        return direct
    match = _SUBSCRIPT.fullmatch(term)
    base = _wildcard(inventory, match["name"]) if match is not None else []
    if match is not None and base:
        return _part(base, match)
    try:
        wanted = set(ranges.expand(term))
    except ValueError as error:
        raise UsageError(str(error), code=Code.OPTION_VALUE) from None
    return [name for name in inventory.hosts if name in wanted]


def _wildcard(inventory: Inventory, term: str) -> list[str]:
    if term in ("all", "*"):
        return sorted(inventory.hosts)
    if term in inventory.hosts or term in inventory.groups:
        return sorted({term} & set(inventory.hosts) | set(inventory.groups.get(term, ())))
    if "[" in term or not set("*?") & set(term):
        return []
    return _named(inventory, lambda name: fnmatch.fnmatchcase(name, term))


def _named(inventory: Inventory, fits: object) -> list[str]:
    assert callable(fits)
    groups = [
        host
        for name, hosts in inventory.groups.items()
        if name not in ("all", "ungrouped") and fits(name)
        for host in hosts
    ]
    return sorted({*groups, *(name for name in inventory.hosts if fits(name))})


def _part(hosts: list[str], match: re.Match[str]) -> list[str]:
    """Return one host of a group by position, or a stretch, whose end counts too."""
    if match["one"] is not None:
        index = int(match["one"])
        return hosts[index : index + 1 or None] if -len(hosts) <= index < len(hosts) else []
    last = int(match["last"]) + 1 if match["last"] else None
    return hosts[int(match["first"] or 0) : last]


def _known(inventory: Inventory) -> str:
    groups = ", ".join(name for name in inventory.groups if name != "ungrouped")
    return f"hosts: {few(list(inventory.hosts), 20) or 'none'}; groups: {groups}"
