"""What this machine trusts, as the top layer of the lab's Debian image.

Behind a company's proxy or package mirror a plain Debian can install nothing: it knows neither
the certificates nor the sources. This layer carries the machine's: CA bundle, local certificates,
apt sources of Debian, apt's settings, and pip's index. Reads the machine; gives paths in the
image and their contents. Names and passwords stay here: every container of a lab reads its image,
a stranger's too, and a bundle may hold it.
"""

from __future__ import annotations

import configparser
import io
import re
from pathlib import Path
from urllib.parse import urlsplit

BUNDLE = "etc/ssl/certs/ca-certificates.crt"
LOCAL_CERTIFICATES = "usr/local/share/ca-certificates"
DEFAULT_MIRROR = "http://deb.debian.org/debian"
SUITE = "bookworm"
PIP_KEPT = ("index-url", "extra-index-url", "trusted-host", "proxy", "timeout")

_LOGIN = re.compile(r"(?<=://)[^/?#\s\"']*@")
_BARE_LOGIN = re.compile(r"[^/?#\s\"']*@")
"""Of a proxy that pip is told without a scheme."""
_SECRET = re.compile(r"ProxyLogin|passw|token|secret", re.IGNORECASE)

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
        if path.is_file():
            found[str(path.relative_to("/"))] = path.read_bytes()
    found |= _apt_sources() | _apt_settings()
    found["etc/pip.conf"] = pip_conf(_read("/etc/pip.conf"), f"/{BUNDLE}").encode()
    return found


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


def without_login(text: str) -> str:
    """A text whose addresses have no name and no password before the host."""
    return _LOGIN.sub("", text)


def kept_here() -> list[str]:
    """The files of this machine of which a name, a password or a token is not in the image."""
    settings = {path: text for path in _setting_files() if _is_taken(text := _read(path))}
    others = {path: _read(path) for path in (*_source_files(), Path("/etc/pip.conf"))}
    left_out = {path for path, text in settings.items() if _is_secret(text)}
    cut = {path for path, text in {**settings, **others}.items() if without_login(text) != text}
    return sorted(map(str, left_out | cut))


def pip_conf(real: str, bundle: str) -> str:
    """Settings of pip for the image: the machine's index and the bundle, none of its files and passwords."""
    parser = configparser.ConfigParser(interpolation=None)
    parser.read_string(real)
    kept = {}
    for key in PIP_KEPT:
        words = parser.get("global", key, fallback="").split()
        words = [_LOGIN.sub("", word) for word in words if not word.startswith("file:")]
        words = [word if "://" in word else _BARE_LOGIN.sub("", word) for word in words]
        if words:
            kept[key] = " ".join(words)
    target = configparser.ConfigParser(interpolation=None)
    target["global"] = {"cert": bundle, **kept}
    text = io.StringIO()
    target.write(text)
    return text.getvalue()


def _source_files() -> list[Path]:
    folder = Path("/etc/apt/sources.list.d")
    single = Path("/etc/apt/sources.list")
    return [single, *sorted(folder.glob("*.list")), *sorted(folder.glob("*.sources"))]


def _all_sources() -> str:
    return "\n".join(_read(path) for path in _source_files())


def _apt_sources() -> dict[str, bytes]:
    """The machine's sources of this very Debian release, or the default; no other vendor's."""
    lines, stanzas = [], []
    for path in _source_files():
        if path.suffix == ".sources":
            stanzas += [each for each in without_login(_read(path)).split("\n\n") if is_debian(each)]
        else:
            lines += [line for line in without_login(_read(path)).splitlines() if is_debian(line)]
    if not lines and not stanzas:
        lines = [f"deb {DEFAULT_MIRROR} {SUITE} main"]
    return {
        "etc/apt/sources.list": "".join(f"{line}\n" for line in lines).encode(),
        "etc/apt/sources.list.d/debian.sources": "\n\n".join(stanzas).encode(),
    }


def is_debian(source: str) -> bool:
    """Whether a source (one line or a stanza) is one of Debian's archives for our release."""
    words = [word for line in source.splitlines() if not line.startswith("#") for word in line.split()]
    archives = [urlsplit(word).path.rstrip("/") for word in words if "://" in word]
    ours = any(word.startswith(SUITE) for word in words)
    return ours and any(path.endswith(("/debian", "/debian-security")) for path in archives)


def _apt_settings() -> dict[str, bytes]:
    """Proxies, timeouts and checks; the machine's other habits are its own."""
    found = {}
    for path in _setting_files():
        text = without_login(_read(path))
        if _is_taken(text) and not _is_secret(text):
            found[str(path.relative_to("/"))] = text.encode()
    return found


def _setting_files() -> list[Path]:
    every = [Path("/etc/apt/apt.conf"), *sorted(Path("/etc/apt/apt.conf.d").glob("*"))]
    return [path for path in every if "docker" not in path.name]


def _is_taken(text: str) -> bool:
    return "Acquire::" in text


def _is_secret(text: str) -> bool:
    """Whether settings hold a password elsewhere than in an address."""
    return _SECRET.search(without_login(text)) is not None


def _read(path: Path | str) -> str:
    try:
        return Path(path).read_text()
    except (FileNotFoundError, IsADirectoryError):
        return ""
