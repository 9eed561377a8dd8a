"""Which logging asks for a permission: what leaves the engine, or what costs the engine itself. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator

from srprov.definitions.containermodel import Logging
from srprov.planning.graver import MAY_BE, TOLD, noted

JOURNAL = "root's programs may go by what stands there"
"""Those that look for lines of an sshd, say, and act on them."""
_LOGS = ("", "json-file", "local", "none")
"""Log drivers that write what only the engine reads; the empty one is what the robot's owner chose."""
_BOUNDS = ("max-size", "max-file", "compress", "mode")
"""Options that say nothing of the lines. The owner's driver may send these to root's programs, where a `tag` with a
command in it, or a variable, has lines of its own."""
ANY_DRIVER = f"no driver is named, such as json-file, so the engine's own has it, which may be any: {TOLD}"
_SIZE = r"((6[4-9]|[7-9]\d|[1-9]\d{2,6})k|[1-9]\d{0,5}[mg]|[1-9]\d{5,11})(i?b)?"
_LOG_OPTIONS = {
    "max-size": re.compile(_SIZE, re.ASCII | re.IGNORECASE),
    "max-file": re.compile("[1-9][0-9]?|100"),
    "compress": re.compile("true|false"),
    "mode": re.compile("blocking|non-blocking"),
    "labels": re.compile("[A-Za-z0-9_./,-]{1,500}"),
    "env": re.compile("[A-Za-z0-9_,]{1,500}"),
    "tag": re.compile(r"([A-Za-z0-9_./: -]|\{\{ ?\.[A-Z][A-Za-z]{1,30} ?\}\}){1,200}"),
}
"""Options that say how much such a driver keeps, and what it writes beside the lines, with values that cost little.

The engine itself computes a template of `tag`, and moves every kept file when one is full: outside of any limit.
"""
_COSTS = frozenset({*_LOG_OPTIONS, "labels-regex", "env-regex", "max-buffer-size", "cache-disabled"})
"""What else costs the engine at most its time and the disk: options that it does not know yet may do anything."""


def of_logging(log: Logging | None) -> Iterator[str]:
    """Return what the engine itself, as root and from the robot's own network, would do with what is printed."""
    plain = log is None or log.driver in _LOGS
    if log and not plain:
        journal = log.driver == "journald"
        place = "into the robot's own journal" if journal else "wherever it is told"
        yield noted(f"driver {log.driver}: the engine sends what is printed {place}", JOURNAL if journal else TOLD)
    for name, value in sorted(log.options.items()) if log else ():
        form = _LOG_OPTIONS.get(name) if plain and log and (log.driver or name in _BOUNDS) else None
        if form is None or not form.fullmatch(value):
            yield noted(f"option {name}={value}", _of_option(name, log) if plain and log else "")


def _of_option(name: str, log: Logging) -> str:
    """Return why an option of a driver that sends nothing is more than it looks; what a driver sends, that one says."""
    return ANY_DRIVER if not log.driver else "" if name in _COSTS else MAY_BE
