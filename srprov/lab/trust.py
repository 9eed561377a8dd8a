"""What this machine trusts, as the top layer of the lab's Debian image.

Behind a company's proxy or package mirror a plain Debian can install nothing: it knows neither
the certificates nor the sources. This layer carries the machine's: CA bundle, local certificates,
apt sources of Debian, apt's settings, and pip's index. Reads the machine; gives paths in the
image and their contents. Names and passwords stay here: every container of a lab reads its image,
a stranger's too, and a bundle may hold it. So no text of the machine's goes there: what is known is
written anew, from words of known forms (`trust_apt.py`, `plain_address.py`).
"""

from __future__ import annotations

import configparser
import io
import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from urllib.parse import urlsplit

from srprov.lab.machine import find
from srprov.lab.plain_address import HOST, plain_address, plain_proxy
from srprov.lab.trust_apt import SUITE, is_debian, settings, source, stanza

BUNDLE = "etc/ssl/certs/ca-certificates.crt"
LOCAL_CERTIFICATES = "usr/local/share/ca-certificates"
DEFAULT_MIRROR = "http://deb.debian.org/debian"

_SETTINGS = "etc/apt/apt.conf.d/90machine"
_CERTIFICATE = re.compile(rb"-----BEGIN ((?:X509 |TRUSTED )?CERTIFICATE)-----[A-Za-z0-9+/=\s]+?-----END \1-----")
_SECRET = re.compile(r"://.*@|ProxyLogin|passw|token|secret", re.IGNORECASE)

# As in Debian's own image: a build starts no services, keeps no downloads, needs no fsync.
CONTAINER_HABITS = {
    "etc/apt/apt.conf.d/docker-clean": b'Dir::Cache::pkgcache "";\nDir::Cache::srcpkgcache "";\n'
    b'APT::Keep-Downloaded-Packages "false";\n',
    "etc/apt/apt.conf.d/docker-no-languages": b'Acquire::Languages "none";\n',
    "etc/dpkg/dpkg.cfg.d/docker-apt-speedup": b"force-unsafe-io\n",
}


def files() -> dict[str, bytes]:
    """Path in the image -> content."""
    found = dict(CONTAINER_HABITS)
    for path in (Path("/", BUNDLE), *sorted(Path("/", LOCAL_CERTIFICATES).glob("**/*.crt"))):
        if path.is_file() and (kept := certificates(path.read_bytes())):
            found[str(path.relative_to("/"))] = kept
    found |= _apt_sources()
    if taken := settings(_apt_config()):
        found[_SETTINGS] = taken.encode()
    found["etc/pip.conf"] = pip_conf(_read("/etc/pip.conf"), f"/{BUNDLE}").encode()
    return found


def certificates(text: bytes) -> bytes:
    """The certificates in a file, which may hold a key beside them."""
    return b"".join(match[0] + b"\n" for match in _CERTIFICATE.finditer(text))


def environment() -> dict[str, str]:
    """Variables for programs that bring their own certificates and must be told of these."""
    if not any(Path("/", LOCAL_CERTIFICATES).glob("**/*.crt")):
        return {}
    return dict.fromkeys(("NODE_EXTRA_CA_CERTS", "SSL_CERT_FILE"), f"/{BUNDLE}")


def mirror() -> str:
    """The Debian mirror that this machine uses, for debootstrap."""
    for words in map(str.split, _all_sources().splitlines()):
        candidates = [word for word in words if "://" in word]
        if words and words[0] in ("deb", "URIs:") and candidates:
            found = candidates[0].rstrip("/")
            if urlsplit(found).path.endswith("/debian"):
                return found
    return DEFAULT_MIRROR


def kept_here() -> list[str]:
    """The files of this machine that hold a name, a password or a token, which is not in the image."""
    pip = Path("/etc/pip.conf")
    every = [pip, *_source_files(), *(path for path in _setting_files() if "Acquire::" in _read(path))]
    return sorted(str(path) for path in every if _SECRET.search(text := _read(path)) or (path == pip and "@" in text))


def pip_conf(real: str, bundle: str) -> str:
    """Settings of pip for the image: the machine's index and the bundle, none of its files and passwords."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(real)
    kept = {}
    for key, form in _PIP_KEPT.items():
        given = parser.get("global", key, fallback="").strip()
        words = given.split() if key in _PIP_LISTS else [given]
        if written := " ".join(filter(None, map(form, words))):
            kept[key] = written
    target = configparser.ConfigParser(interpolation=None)
    target["global"] = {"cert": bundle, **kept}
    text = io.StringIO()
    target.write(text)
    return text.getvalue()


def _formed(form: str) -> Callable[[str], str]:
    return lambda word: word if re.fullmatch(form, word) else ""


_PIP_LISTS = ("extra-index-url", "trusted-host")
_PIP_KEPT: dict[str, Callable[[str], str]] = {
    "index-url": plain_address,
    "extra-index-url": plain_address,
    "trusted-host": _formed(f"{HOST}(?::[0-9]{{1,5}})?"),
    "proxy": plain_proxy,
    "timeout": _formed(r"[0-9]{1,6}(?:\.[0-9]{1,6})?"),
}
"""Setting of pip's -> what writes a value of it, or nothing."""


def _source_files() -> list[Path]:
    folder = Path("/etc/apt/sources.list.d")
    single = Path("/etc/apt/sources.list")
    return [single, *sorted(folder.glob("*.list")), *sorted(folder.glob("*.sources"))]


def _all_sources() -> str:
    return "\n".join(_read(path) for path in _source_files())


def _apt_sources() -> dict[str, bytes]:
    """The machine's sources of this very Debian release, or the default; no other vendor's."""
    lines: list[str] = []
    stanzas: list[str] = []
    for path in _source_files():
        if path.suffix == ".sources":
            stanzas += [made for each in _read(path).split("\n\n") if is_debian(made := stanza(each))]
        else:
            lines += [made for line in _read(path).splitlines() if is_debian(made := source(line))]
    if not lines and not stanzas:
        lines = [f"deb {DEFAULT_MIRROR} {SUITE} main"]
    return {
        "etc/apt/sources.list": "".join(f"{line}\n" for line in lines).encode(),
        "etc/apt/sources.list.d/debian.sources": "\n\n".join(stanzas).encode(),
    }


def _apt_config() -> str:
    """What apt makes of its own files; nothing where there is no apt, or where it cannot read them."""
    program = find("apt-config")
    if program is None:
        return ""
    done = subprocess.run([program, "dump"], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else ""


def _setting_files() -> list[Path]:
    return [Path("/etc/apt/apt.conf"), *sorted(Path("/etc/apt/apt.conf.d").glob("*"))]


def _read(path: Path | str) -> str:
    try:
        return Path(path).read_text()
    except (FileNotFoundError, IsADirectoryError):
        return ""
