"""Where a robot's apt fetches packages from, and which of these archives are the distribution's own.

Takes the lines of apt's lists, each behind its file's name; gives sources, written anew from checked words. Pure. A
password in an address is left out and noted.

Source: sources.list(5).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from urllib.parse import SplitResult, urlsplit

import msgspec

from srprov.snapshot.gitscript import NOBODY, Found, confined
from srprov.snapshot.notes import Notes
from srprov.snapshot.repositories import decoded
from srprov.untrusted import lines_of, text
from srprov.wire import Query, quote, sh

MOST = 40
_MOST_KEY = 128 << 10
_MOST_KEYS = 2 << 20
_KEY_S = 2
_HOSTS = ("debian.org", "ubuntu.com", "raspbian.org", "raspberrypi.com", "raspberrypi.org", "debian.net")
_MOST_ORIGINS = 512 << 10
_ORIGINS = ("Debian", "Debian Backports", "Ubuntu", "Raspbian", "Raspberry Pi Foundation")
_POLICY_URL = re.compile(r" {0,4}-?[0-9]{1,6} (https?://\S{1,500}) .{1,300}")
_POLICY_ORIGIN = re.compile(r" {4,10}release (?:.{0,300},)?o=([^,]{1,100}),.{0,500}")
_ABOVE = ("", "pub", "mirror", "mirrors", "ftp", "pub/linux")
"""What may stand above the distribution's folder on a mirror."""
_FOLDERS = ("debian", "debian-security", "debian-archive", "ubuntu", "ubuntu-ports", "ubuntu-security", "raspbian")
_ONE_LINE = re.compile(r"deb\s+(?:\[(?P<options>[^\]]{0,1000})\]\s+)?(?P<rest>\S.{0,1000})")
_URL = re.compile(r"https?://[A-Za-z0-9.:\[\]-]{1,250}(?:/[A-Za-z0-9._~+%@=,:/-]{0,500})?")
_WORD = re.compile(r"[A-Za-z0-9][A-Za-z0-9._+/-]{0,100}")
_SUITE = re.compile(r"[A-Za-z0-9./][A-Za-z0-9._+/-]{0,100}")
_KEY = re.compile(r"/(?:usr/share|etc/apt|usr/local/share)(?:/[A-Za-z0-9][A-Za-z0-9._+-]{0,100}){1,4}/?")


class Source(msgspec.Struct, frozen=True):
    """One archive."""

    url: str
    suite: str
    components: tuple[str, ...] = ()
    arch: str = ""
    key: str = ""
    """Absolute path of the keys that it is signed with; empty: any that apt trusts."""

    def line(self) -> str:
        """Return it as a line of a list."""
        options = [f"arch={self.arch}"] * bool(self.arch) + [f"signed-by={self.key}"] * bool(self.key)
        shown = f"[{' '.join(options)}] " if options else ""
        return " ".join([f"deb {shown}{self.url}", self.suite, *self.components])


def is_distributions(url: str, origins: Mapping[str, str] = MappingProxyType({})) -> bool:
    """Return whether an address is an archive of the distribution, or a mirror of one.

    Who signed it says so; where that is not known, its host or folder.
    """
    if origin := origins.get(url.rstrip("/"), ""):
        return origin in _ORIGINS
    parts = _parts(url)
    if parts is None:
        return False
    host = (parts.hostname or "").lower()
    above, _, folder = parts.path.strip("/").rpartition("/")
    known = any(host == one or host.endswith(f".{one}") for one in _HOSTS)
    return known or (folder.lower() in _FOLDERS and above.lower() in _ABOVE)


def origins_query() -> Query:
    """Ask apt who signed its archives; it is told to write no cache."""
    no_cache = sh("apt-cache", "-o", "Dir::Cache::pkgcache=", "-o", "Dir::Cache::srcpkgcache=", "policy")
    return Query(command=f"timeout 20 {no_cache} 2>/dev/null | head -c {_MOST_ORIGINS}\n:", timeout_s=40)


def parse_origins(out: str) -> dict[str, str]:
    """Return the address of each archive -> who signed it, as it calls itself."""
    found: dict[str, str] = {}
    url = ""
    for line in lines_of(out, 4000):
        if match := _POLICY_URL.fullmatch(line):
            url = match[1].rstrip("/")
        elif url and (match := _POLICY_ORIGIN.fullmatch(line)):
            found.setdefault(url, match[1])
            url = ""
    return found


def parse_sources(out: str, notes: Notes) -> tuple[Source, ...]:
    """Read all lists; what is no source that can be written again is noted."""
    files: dict[str, list[str]] = {}
    for line in lines_of(out, 8192):
        path, colon, rest = line.partition(":")
        if colon and path.startswith("/etc/apt/"):
            files.setdefault(path, []).append(rest)
    found: dict[Source, None] = {}
    for path, lines in files.items():
        read = _deb822(path, lines, notes) if path.endswith(".sources") else _one_line(path, lines, notes)
        for source in read:
            found[source] = None
    if len(found) > MOST:
        notes.lost("apt sources", f"only {MOST} of {len(found)} are kept")
    return tuple(found)[:MOST]


def _one_line(path: str, lines: list[str], notes: Notes) -> Iterator[Source]:
    for line in lines:
        match = _ONE_LINE.fullmatch(line.partition("#")[0].strip())
        if match is None:
            continue
        options = dict(one.partition("=")[::2] for one in (match["options"] or "").split())
        words = match["rest"].split()
        yield from _source(path, words[:1], words[1:2], words[2:], options, notes)


def _deb822(path: str, lines: list[str], notes: Notes) -> Iterator[Source]:
    stanza: dict[str, str] = {}
    key = ""
    for line in [*lines, ""]:
        if line.startswith("#"):
            continue
        if line.strip() and line[0] in " \t" and key:
            stanza[key] += f"\n{line.strip()}"
        elif line.strip():
            key, _, value = line.partition(":")
            key = key.strip().lower()
            stanza[key] = value.strip()
        elif stanza:
            if "deb" in stanza.get("types", "").split() and stanza.get("enabled", "yes").lower() not in ("no", "false"):
                options = {"arch": ",".join(stanza.get("architectures", "").split()),
                           "signed-by": stanza.get("signed-by", "")}  # fmt: skip
                words = [stanza.get(one, "").split()[:20] for one in ("uris", "suites", "components")]
                yield from _source(path, words[0], words[1], words[2], options, notes)
            stanza, key = {}, ""


def _source(
    path: str, urls: list[str], suites: list[str], components: list[str], options: dict[str, str], notes: Notes
) -> Iterator[Source]:
    key, arch = options.get("signed-by", ""), options.get("arch", "")
    for url in urls:
        parts = _parts(url)
        if parts is not None and "@" in parts.netloc:
            notes.secret(f"apt source in {path}", "its address holds a user or password: it is left out")
        elif (
            parts is None
            or not _URL.fullmatch(url)
            or not all(map(_WORD.fullmatch, components))
            or (arch and not all(map(_WORD.fullmatch, arch.split(","))))
        ):
            notes.lost(f"apt source in {path}", "has a form that is not written again")
        elif key and not _KEY.fullmatch(key):
            shown = "inside of the list" if "\n" in key else text(key, length=80)
            notes.lost(f"apt source {url}", f"its key is {shown}, which is not read")
        else:
            for suite in suites:
                if _SUITE.fullmatch(suite):
                    yield Source(url, suite, tuple(components), arch, key)


def _parts(url: str) -> SplitResult | None:
    """Return the parts of an address; None where a bracket encloses no address of IPv6."""
    try:
        return urlsplit(url)
    except ValueError:
        return None


def keys_query(found: Sequence[Source], *, root: bool) -> Query:
    """Ask for the public keys of archives: by path, or all that apt trusts where an archive names none.

    Links lead to some of them, and not only root may write where these lead: a shell of root's reads what everybody
    may read, as apt does.
    """
    paths = [quote(path) for path in sorted({one.key for one in found if one.key})[:MOST]]
    if any(not one.key for one in found):
        paths += ["/etc/apt/trusted.gpg.d/*.gpg", "/etc/apt/trusted.gpg.d/*.asc"]
    who = confined(Found(folder="/", uid=NOBODY), _KEY_S, root=True) if root else ("timeout", str(_KEY_S))
    read = f"{sh(*who)} head -c {_MOST_KEY} \"$f\" 2>/dev/null | base64 | tr -d '\\n'"
    return Query(
        command=f'for f in {" ".join(paths)}; do [ -f "$f" ] || continue; printf \'%s \' "$f"; {read}; echo; done'
        f" | head -c {_MOST_KEYS}\n:"
    )


def parse_keys(out: str) -> dict[str, bytes]:
    """Return path -> what the file holds; one that is not whole is left out."""
    found = {}
    for line in lines_of(out, 2 * MOST):
        path, _, coded = line.partition(" ")
        content = decoded(coded)
        if _KEY.fullmatch(path) and 0 < len(content) < _MOST_KEY and b"PRIVATE KEY" not in content:
            found[path] = content
    return found
