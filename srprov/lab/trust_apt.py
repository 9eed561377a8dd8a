"""Apt's sources and settings of this machine, as the lab's Debian image has them. Pure.

Takes lines, stanzas, and what `apt-config dump` says; gives the same, written anew from words of known forms. What has
another form is left out, comments too: anywhere else a password may stand.

Source: sources.list(5), apt.conf(5), apt-transport-http(1).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from urllib.parse import urlsplit

from srprov.lab.plain_address import HOST, plain_address

SUITE = "bookworm"

_SETTING = re.compile(r'(Acquire::\S+) "(.*)";')
_PROXY = re.compile(rf"Acquire::https?::Proxy(?:::{HOST})?")
_FIGURE = re.compile(
    "Acquire::(?:Retries|Check-Valid-Until|Check-Date|M(?:ax|in)-ValidTime|ForceIPv[46]"
    "|AllowInsecureRepositories|AllowWeakRepositories|AllowDowngradeToInsecureRepositories"
    rf"|https?::(?:{HOST}::)?(?:Timeout|ConnectionAttemptDelayMsec|Pipeline-Depth|No-Cache|No-Store|Max-Age"
    "|AllowRedirect|Verify-Peer|Verify-Host))"
)
_WORTH = re.compile("[0-9]{1,9}|true|false|yes|no|on|off")
_LINE = re.compile(r"(?P<kind>deb|deb-src)\s+(?:\[(?P<options>[^\]]*)\]\s+)?(?P<address>\S+)\s+(?P<words>\S.*)")
_OPTION = re.compile(r"arch=[a-z0-9,-]+|signed-by=/[\w./+-]+|(?:trusted|check-valid-until)=(?:yes|no)", re.ASCII)
_WORD = re.compile(r"[A-Za-z0-9./][\w./+-]*", re.ASCII)
_NAMED = re.compile(r"types|suites|components|architectures|signed-by|enabled|trusted|check-valid-until")
"""Fields of a stanza whose values are words."""


def source(line: str) -> str:
    """Return a line of a list of sources; nothing for one that has words of other forms."""
    match = _LINE.fullmatch(line.partition("#")[0].strip())
    address = plain_address(match["address"]) if match else ""
    words = match["words"].split() if match else []
    if not match or not address or not all(map(_WORD.fullmatch, words)):
        return ""
    options = [one for one in (match["options"] or "").split() if _OPTION.fullmatch(one)]
    return " ".join([match["kind"], *([f"[{' '.join(options)}]"] if options else []), address, *words])


def stanza(text: str) -> str:
    """Return a stanza of sources, without the fields that are not known."""
    fields: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        name, colon, value = line.partition(":")
        if line[:1] in (" ", "\t") and fields:
            fields[-1][1].extend(line.split())
        elif colon and not line.startswith("#"):
            fields.append((name.strip(), value.split()))
    made = ((name, _value(name.lower(), words)) for name, words in fields)
    return "\n".join(f"{name}: {value}" for name, value in made if value)


def _value(name: str, words: list[str]) -> str:
    if name == "uris":
        words = list(map(plain_address, words))
        return " ".join(words) if all(words) else ""
    return " ".join(words) if _NAMED.fullmatch(name) and all(map(_WORD.fullmatch, words)) else ""


def is_debian(source: str) -> bool:
    """Whether a source (one line or a stanza) is one of Debian's archives for our release."""
    words = [word for line in source.splitlines() if not line.startswith("#") for word in line.split()]
    archives = [urlsplit(word).path.rstrip("/") for word in words if "://" in word]
    ours = any(word.startswith(SUITE) for word in words)
    return ours and any(path.endswith(("/debian", "/debian-security")) for path in archives)


def settings(dump: str) -> str:
    """Return the proxies, timeouts and checks of what apt says of its settings; others are the machine's own habits."""
    return "".join(f'{name} "{value}";\n' for name, value in _known(dump))


def _known(dump: str) -> Iterator[tuple[str, str]]:
    for match in filter(None, map(_SETTING.fullmatch, dump.splitlines())):
        name, value = match.groups()
        if _PROXY.fullmatch(name) and (address := value if value == "DIRECT" else plain_address(value)):
            yield name, address
        elif _FIGURE.fullmatch(name) and _WORTH.fullmatch(value):
            yield name, value
