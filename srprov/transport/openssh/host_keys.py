"""Strict host keys: what known_hosts files say of a robot, and the errors when it shows another key or an unknown one.

Takes file paths, the names to look for and the key that the robot showed; raises HostKeyError or returns. A robot is
known by its address with its port: behind one address there may be several, and none speaks for another. The only
thing it writes is one line per new robot under `accept-new`. paramiko's own loader forgets file and line, wildcards,
`!` and `@revoked`; so the files are read here (format: sshd(8), SSH_KNOWN_HOSTS).
"""

from __future__ import annotations

import base64
import binascii
import fnmatch
import functools
import hashlib
import hmac
import os
import threading
from collections.abc import Iterator, Sequence

import msgspec

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import HostKeyError
from srprov.transport.openssh.key_file import place, stands_plain
from srprov.transport.openssh.settings import SshSettings
from srprov.wire import sh

_appending = threading.Lock()
_PATTERN = frozenset("*?!|")
"""What stands in no name that means itself alone."""
_Line = tuple[int, str, str, str, str]
"""Its number, its marker, whom it speaks of, and the type and the base64 of the key."""


class KnownKey(msgspec.Struct, frozen=True):
    """One line of a known_hosts file that speaks of the robot."""

    file: str
    line: int
    marker: str
    """Empty, `@revoked` or `@cert-authority`."""
    kind: str
    """As in `ssh-ed25519`."""
    blob: bytes
    """The public key as SSH sends it."""

    @property
    def fingerprint(self) -> str:
        """Return `SHA256:…` as ssh-keygen -l prints it."""
        return fingerprint(self.blob)


def fingerprint(blob: bytes) -> str:
    """Return a public key's fingerprint as OpenSSH prints it."""
    return "SHA256:" + base64.b64encode(hashlib.sha256(blob).digest()).decode("ascii").rstrip("=")


def names_of(settings: SshSettings) -> tuple[str, str | None]:
    """Return the name that a host goes by in known_hosts, and the bare one, which is that of whoever has port 22."""
    if settings.host_key_alias:
        return settings.host_key_alias.lower(), None
    host = settings.hostname.lower()
    return (host, None) if settings.port == 22 else (f"[{host}]:{settings.port}", host)


def matches(patterns: str, name: str) -> bool:
    """Tell whether the first field of a known_hosts line means a name: plain, wildcard, negated or hashed."""
    if patterns.startswith("|1|"):
        return _hashed(patterns, name)
    found = False
    for pattern in patterns.lower().split(","):
        # Brackets are literal here ([host]:port), while fnmatch takes them for a set of characters.
        if fnmatch.fnmatchcase(name, pattern.lstrip("!").replace("[", "[[]")):
            if pattern.startswith("!"):
                return False
            found = True
    return found


def _hashed(field: str, name: str) -> bool:
    """Compare a name with `|1|salt|HMAC-SHA1(salt, name)`."""
    try:
        _, _, salt, digest = field.split("|")
        wanted = hmac.new(base64.b64decode(salt), name.encode(), hashlib.sha1).digest()
        return hmac.compare_digest(wanted, base64.b64decode(digest))
    except (ValueError, binascii.Error):
        return False


def known_keys(files: Sequence[str], name: str, bare: str | None) -> list[KnownKey]:
    """Read the lines that speak of a host; files that are missing, and lines that are broken, say nothing.

    By its bare name nothing but a revoked key counts: another machine may be there.
    """
    return [key for file in files for key in _of_file(file, name, bare)]


def keys_of(settings: SshSettings) -> list[KnownKey]:
    """Read the lines that speak of a host."""
    return known_keys([*settings.known_hosts, *settings.global_known_hosts], *names_of(settings))


def _of_file(file: str, name: str, bare: str | None) -> Iterator[KnownKey]:
    """Read one known_hosts file."""
    try:
        about = os.stat(file)
        named, others = _lines(file, (about.st_mtime_ns, about.st_size, about.st_ino))
    except OSError:
        return
    plain = {*named.get(name, ()), *(named.get(bare, ()) if bare else ())}
    for number, marker, patterns, kind, text in sorted((*plain, *others)):
        if not matches(patterns, name) and not (bare and marker == "@revoked" and matches(patterns, bare)):
            continue
        try:
            blob = base64.b64decode(text, validate=True)
        except (ValueError, binascii.Error):
            continue
        yield KnownKey(file, number, marker, kind, blob)


@functools.lru_cache(maxsize=8)
def _lines(file: str, _version: tuple[int, int, int]) -> tuple[dict[str, list[_Line]], list[_Line]]:
    """Return the lines by each name that they spell out, and those with patterns or hashes; once for all robots.

    Each robot has a line, so a look at all of them for each robot would take the square of time.
    """
    named: dict[str, list[_Line]] = {}
    others: list[_Line] = []
    for number, line in enumerate(regular_file.read_text(file, errors="replace").split("\n"), 1):
        words = line.split()
        marker = words.pop(0) if words and words[0].startswith("@") else ""
        if len(words) < 3 or words[0].startswith("#"):
            continue
        found = number, marker, words[0], words[1], words[2]
        if _PATTERN.isdisjoint(words[0]):
            for name in words[0].lower().split(","):
                named.setdefault(name, []).append(found)
        else:
            others.append(found)
    return named, others


def check(settings: SshSettings, known: Sequence[KnownKey], kind: str, blob: bytes) -> None:
    """Accept the key that a robot shows, or raise; under accept-new an unknown one is written down.

    Args:
        settings: Names, files and policy.
        known: `known_keys` for this host.
        kind: Type of the key shown, such as `ssh-ed25519`.
        blob: The key shown.

    Raises:
        HostKeyError: Unknown, changed or revoked.
    """
    if any(k.marker == "@revoked" and k.blob == blob for k in known):
        raise HostKeyError(
            settings.name,
            f"its host key {fingerprint(blob)} is marked @revoked",
            hint="do not connect; ask who revoked it",
            code=Code.HOST_KEY_CHANGED,
        )
    plain = [k for k in known if not k.marker]
    if any(k.blob == blob for k in plain):
        return
    if plain:
        raise _changed(settings, next((k for k in plain if k.kind == kind), plain[0]), kind, blob)
    # accept-new without a place to remember the key would accept any key, every time.
    if not settings.accept_new or place(settings)[0] == os.devnull:
        raise _unknown(settings, kind, blob, any(k.marker == "@cert-authority" for k in known))
    _append(settings, kind, blob)


def _changed(settings: SshSettings, old: KnownKey, kind: str, blob: bytes) -> HostKeyError:
    """Say that a robot shows another key than the one on record."""
    name, _ = names_of(settings)
    new = f"{kind} {fingerprint(blob)}"
    return HostKeyError(
        settings.name,
        f"its host key changed: it shows {new}, but {old.file}:{old.line} has {old.kind} {old.fingerprint}",
        hint=(
            "somebody may be in between, or the robot was set up anew. If its own console shows the new fingerprint "
            f"({_on_console(kind)}), forget the old key: {sh('ssh-keygen', '-f', old.file, '-R', name)}"
        ),
        code=Code.HOST_KEY_CHANGED,
    )


def _unknown(settings: SshSettings, kind: str, blob: bytes, authority: bool) -> HostKeyError:
    """Say that nothing is on record for a robot, and how to put it there."""
    target, unfit = place(settings)
    if settings.proxy_jump or settings.proxy_command or settings.host_key_alias:
        name, bare = names_of(settings)
        # where ssh knows the key by the bare name, it would ask nothing and write nothing
        alias = ("-o", f"HostKeyAlias={name}") if bare or settings.host_key_alias else ()
        how = f"connect to it once with ssh, which asks: {sh('ssh', *alias, settings.address)}"
    else:
        port = ("-p", str(settings.port)) if settings.port != 22 else ()
        hashed = () if stands_plain(settings, names_of(settings)[0]) else ("-H",)
        how = f"{sh('ssh-keyscan', *hashed, *port, '-t', _short(kind), settings.hostname)} >> {sh(target)}"
    if target == os.devnull:
        how = f"name a file (-o UserKnownHostsFile=…) in the inventory; then {how.replace(os.devnull, 'that file')}"
    notes = f" ({unfit})" if unfit else ""
    if settings.asked_for_no:
        notes += " (StrictHostKeyChecking=no is not done here; accept-new is)"
    if authority:
        notes += " (known_hosts has a @cert-authority for it, which paramiko cannot check: its own key is needed)"
    return HostKeyError(
        settings.name,
        f"its host key is unknown: {kind} {fingerprint(blob)}{notes}",
        hint=(f"compare the fingerprint with the robot's console ({_on_console(kind)}), then: {how}"),
    )


def _on_console(kind: str) -> str:
    """Return the command that shows a robot's own fingerprint on its console."""
    return f"ssh-keygen -lf /etc/ssh/ssh_host_{_short(kind)}_key.pub"


def _short(kind: str) -> str:
    """Return the name that ssh-keyscan -t and sshd's key files use."""
    return kind.removeprefix("ssh-").removeprefix("rsa-").split("-")[0].replace("sha2", "rsa")


def _append(settings: SshSettings, kind: str, blob: bytes) -> None:
    """Write a new robot's key down, in one write so that two threads never mix lines."""
    name, _ = names_of(settings)
    if settings.hash_known_hosts or not stands_plain(settings, name):
        salt = os.urandom(20)
        digest = hmac.new(salt, name.encode(), hashlib.sha1).digest()
        name = "|1|{}|{}".format(*(base64.b64encode(part).decode("ascii") for part in (salt, digest)))
    file = settings.known_hosts[0]
    line = f"{name} {kind} {base64.b64encode(blob).decode('ascii')}\n"
    try:
        os.makedirs(os.path.dirname(file) or ".", mode=0o700, exist_ok=True)
        with _appending, open(os.open(file, os.O_RDWR | os.O_APPEND | os.O_CREAT, 0o600), "r+b", buffering=0) as stream:
            end = stream.seek(0, os.SEEK_END)
            stream.seek(max(0, end - 1))
            broken = end > 0 and stream.read(1) != b"\n"
            stream.write(b"\n" * broken + line.encode())
    except OSError as error:
        raise HostKeyError(
            settings.name,
            f"its new host key cannot be written to {file}: {error.strerror}",
            hint="correct UserKnownHostsFile",
            code=Code.CANNOT_WRITE,
        ) from None
