"""Image references in one form, so that `debian` and `docker.io/library/debian:latest` are one image.

Takes text; gives a Reference. Pure. Source: the reference grammar of the Docker distribution project
(reference/regexp.go) and its normalisation (reference/normalize.go).
"""

from __future__ import annotations

import re

import msgspec

_DEFAULT_DOMAIN = "docker.io"
_OLD_DOMAINS = ("index.docker.io", "registry-1.docker.io")
_DOMAIN = re.compile(
    r"(?:\[[0-9a-fA-F:]+\]|[A-Za-z0-9](?:[A-Za-z0-9-]*[A-Za-z0-9])?(?:\.[A-Za-z0-9](?:[A-Za-z0-9-]*[A-Za-z0-9])?)*)"
    r"(?::[0-9]+)?"
)
_PATH = re.compile(r"[a-z0-9]+(?:(?:\.|_|__|-+)[a-z0-9]+)*(?:/[a-z0-9]+(?:(?:\.|_|__|-+)[a-z0-9]+)*)*")
_TAG = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,127}")
_DIGEST = re.compile(r"sha256:[0-9a-f]{64}|sha512:[0-9a-f]{128}")
_LONGEST = 255
BUILT = "srprov/"
"""How the name of every image begins that srprov built, or took from a bundle."""
BUNDLED = f"{BUILT}bundled:"
"""How images from bundles are named, in these and on robots; the digits of their configurations' digests follow."""
_PUBLIC = re.compile(r"(?:[a-z0-9-]+\.)+[a-z][a-z0-9-]*")
_PRIVATE = (
    *(".localhost", ".local", ".localdomain", ".internal", ".home.arpa", ".test", ".invalid", ".onion"),
    *(".alt", ".intranet", ".private", ".corp", ".home", ".lan", ".mail", ".arpa"),
)
"""Names that mean another machine in every network, or are nobody's: RFC 6761, 6762 with its appendix G, 7686, 8375 and
9476, and what ICANN keeps for that. `.example`, which documentation has for any name, is left out."""


class Reference(msgspec.Struct, frozen=True, order=True):
    """One image by name; `tag` is empty only where a digest names it."""

    domain: str
    path: str
    tag: str = ""
    digest: str = ""

    @property
    def pinned(self) -> bool:
        """True when it names content, not a tag that may move."""
        return bool(self.digest)

    @property
    def is_of_a_build(self) -> bool:
        """True for a name that srprov gives to what it builds: whoever has that name on Docker Hub builds nothing."""
        return self.domain == _DEFAULT_DOMAIN and self.path.startswith(BUILT)

    @property
    def is_private(self) -> bool:
        """True when the registry is an address, or has no public name: which machine it is depends on the robot."""
        host = re.sub(r":[0-9]+\Z", "", self.domain).lower()
        return _PUBLIC.fullmatch(host) is None or host.endswith(_PRIVATE)

    @property
    def canonical(self) -> str:
        """The full form: `docker.io/library/debian:bookworm`; with a digest the tag says nothing and is left out."""
        return f"{self.domain}/{self.path}" + (f"@{self.digest}" if self.digest else f":{self.tag}")

    @property
    def familiar(self) -> str:
        """The form that Docker shows and takes: `debian:bookworm`, tag and digest both if both were given."""
        name = f"{self.domain}/{self.path}"
        if self.domain == _DEFAULT_DOMAIN:
            name = self.path.removeprefix("library/") if self.path.count("/") == 1 else self.path
        return name + (f":{self.tag}" if self.tag else "") + (f"@{self.digest}" if self.digest else "")


def parse_reference(text: str) -> Reference:
    """Read an image reference as Docker does.

    Raises:
        ValueError: It is none; the message says which part is wrong.
    """
    shown = text[:100]
    rest, at, digest = text.partition("@")
    if at and not _DIGEST.fullmatch(digest):
        raise ValueError(f"'{shown}' has no valid digest: `@sha256:` and 64 hex digits are wanted")
    name, tag = _split_tag(rest)
    if tag is not None and not _TAG.fullmatch(tag):
        raise ValueError(f"'{shown}' has no valid tag")
    domain, path = _split_domain(name)
    if domain == _DEFAULT_DOMAIN and path in ("library/sha256", "library/moby-dangling"):  # the latter in containerd's
        raise ValueError(f"'{shown}' is an id, not a name: it says nothing of where the image comes from")
    if not _DOMAIN.fullmatch(domain):
        raise ValueError(f"'{shown}' has no valid registry name")
    if not _PATH.fullmatch(path) or len(path) > _LONGEST:
        reason = " (it must be lower case)" if path != path.lower() else ""
        raise ValueError(f"'{shown}' has no valid image name{reason}")
    if domain == _DEFAULT_DOMAIN and _split_domain(path) != (domain, path):
        # `docker.io/127.0.0.1/x` is shown, and given to engines, as `127.0.0.1/x`, which leads elsewhere
        raise ValueError(f"'{shown}' has a registry's name behind Docker Hub's")
    return Reference(domain, path, tag or ("" if digest else "latest"), digest)


def bundled_name(config_id: str) -> str:
    """Return how an image of a bundle is named, by the digest of its configuration: it cannot be another image's."""
    return BUNDLED + config_id.removeprefix("sha256:")


def is_of_a_build(name: str) -> bool:
    """Return whether a name is one that srprov gives to what it builds; what is none is no such name."""
    try:
        return parse_reference(name).is_of_a_build
    except ValueError:
        return False


def is_plain(name: str) -> bool:
    """Return whether a name is an image's, as Docker shows it: engines take others too, and give it that one."""
    try:
        return parse_reference(name).familiar == name
    except ValueError:
        return False


def pull_parameters(name: str) -> tuple[tuple[str, str], ...]:
    """Return the parameters by which an engine pulls an image, by digest where the name has one, else by tag."""
    repository, _, digest = name.partition("@")
    if digest:
        return ("fromImage", repository), ("tag", digest)
    head, tag = _split_tag(name)
    return ("fromImage", head or name), ("tag", tag or "latest")


def _split_tag(name: str) -> tuple[str, str | None]:
    """Split off the tag: a colon after the last slash begins it, one before belongs to the registry's port."""
    head, colon, tag = name.rpartition(":")
    return (head, tag) if colon and "/" not in tag else (name, None)


def _split_domain(name: str) -> tuple[str, str]:
    first, slash, rest = name.partition("/")
    # `a/b` is a user's image on Docker Hub; only a dot, a port or `localhost` makes the first part a registry
    is_domain = bool(slash) and (any(c in first for c in ".:") or first == "localhost" or first != first.lower())
    domain, path = (first, rest) if is_domain else (_DEFAULT_DOMAIN, name)
    if domain in _OLD_DOMAINS:
        domain = _DEFAULT_DOMAIN
    if domain == _DEFAULT_DOMAIN and "/" not in path:
        path = f"library/{path}"
    return domain, path
