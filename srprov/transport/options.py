"""How one host is reached: inventory, `-o` options and ssh_config become one `SshSettings`.

Takes a `Host`, gives a frozen value; reads ssh_config files and may start `ssh -G`. The order is OpenSSH's: what the
inventory names, then its `-o` options, then ~/.ssh/config, then /etc/ssh/ssh_config; the first value wins,
IdentityFile adds up. paramiko's parser knows no Include and only part of Match: a configuration with one of them is
resolved by OpenSSH itself.
"""

from __future__ import annotations

import functools
import getpass
import glob
import os
import re
import shlex
import socket
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from srprov.definitions.model import Host
from srprov.errors import ConnectError
from srprov.secret import Secret

_BEYOND_PARAMIKO = re.compile(r"^\s*(include|match)\b\s*=?\s*(.*)$", re.IGNORECASE | re.MULTILINE)
_NO_WORD = re.compile(r"^-|[\s\x00-\x1f\x7f'`\"$\\;&<>|(){}]")
_DEFAULT_KEYS = ("id_ed25519", "id_ecdsa", "id_rsa")
_SSH_G_KEYS = frozenset({*_DEFAULT_KEYS, "id_ecdsa_sk", "id_ed25519_sk", "id_xmss", "id_dsa"})
_ADDS_UP = frozenset({"identityfile", "certificatefile"})


@dataclass(frozen=True, kw_only=True, slots=True)
class SshSettings:
    """All that a connection needs to know, with `~` and %-tokens expanded."""

    name: str
    """The robot's name in the inventory."""
    hostname: str
    port: int = 22
    user: str
    identity_files: tuple[str, ...] = ()
    """In the order in which they are tried; the default ones when nothing is configured."""
    identities_configured: bool = False
    identities_only: bool = False
    identity_agent: str | None = None
    """Socket of the agent, None for none."""
    password: Secret | None = None
    known_hosts: tuple[str, ...] = ()
    """UserKnownHostsFile; the first is the one that accept-new adds to."""
    global_known_hosts: tuple[str, ...] = ()
    host_key_alias: str | None = None
    accept_new: bool = False
    asked_for_no: bool = False
    """StrictHostKeyChecking=no was asked for, and is not done."""
    hash_known_hosts: bool = False
    proxy_jump: tuple[str, ...] = ()
    proxy_command: str | None = None
    address_family: int = socket.AF_UNSPEC
    connect_timeout_s: float | None = None
    ssh_config: Path | None = None
    """The file that was read instead of the usual ones; jump hosts are looked up there too."""
    inherited: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    """The options that a jump host on the way takes over: where its host key may be found."""


def settle(host: Host, *, ssh_config: Path | None = None) -> SshSettings:
    """Find out how to reach a host.

    Raises:
        ConnectError: ssh_config cannot be read or resolved.
    """
    given = _first_wins(host)
    config = _lookup(host.name, host.address, given, ssh_config)
    for key, values in given.items():
        config[key] = [*values, *config.get(key, [])] if key in _ADDS_UP else values
    return _settings(host, {key: values for key, values in config.items() if values}, given, ssh_config)


def _first_wins(host: Host) -> dict[str, list[str]]:
    """Give what the inventory says, its own variables before its `-o` options."""
    own = (("port", host.port), ("user", host.user), ("identityfile", host.identity_file))
    given: dict[str, list[str]] = {key: [str(value)] for key, value in own if value}
    for key, value in host.ssh_options:
        if key in _ADDS_UP:
            given.setdefault(key, []).append(value)
        else:
            given.setdefault(key, [value])
    return given


def _lookup(name: str, address: str, given: Mapping[str, Sequence[str]], chosen: Path | None) -> dict[str, list[str]]:
    """Give what the configuration files say about an address, by lower-case keyword."""
    texts = config_texts(chosen)
    if any(needs_openssh(text, file) for file, text in texts.items()):
        return _ssh_g(name, address, given, chosen)
    found: dict[str, list[str]] = {}
    for text in texts.values():
        for key, value in _parse(name, text, address).items():
            if key in _ADDS_UP:
                found.setdefault(key, []).extend(value)
            else:
                found.setdefault(key, value)
    return found


def config_texts(chosen: Path | None) -> dict[Path, str]:
    """Give the configuration files that exist, the first to win first; raises OSError for one that cannot be read."""
    files = [chosen] if chosen else [Path("~/.ssh/config").expanduser(), Path("/etc/ssh/ssh_config")]
    return {file: _text(file, os.stat(file).st_mtime_ns) for file in files if file.is_file()}


@functools.lru_cache(maxsize=8)
def _text(file: Path, _mtime_ns: int) -> str:
    """Read one configuration file, once per version of it."""
    return file.read_text(encoding="utf-8", errors="replace")


def needs_openssh(text: str, file: Path) -> bool:
    """Tell whether paramiko's parser would misread a text. An Include that names no existing file does no harm."""
    for keyword, rest in _BEYOND_PARAMIKO.findall(text):
        if keyword.lower() == "match":
            return True
        base = file.parent if file.parent == Path("/etc/ssh") else Path("~/.ssh").expanduser()
        if any(glob.glob(str(base / Path(word).expanduser())) for word in _words(rest)):
            return True
    return False


def _parse(name: str, text: str, address: str) -> dict[str, list[str]]:
    """Look an address up in a simple ssh_config."""
    import paramiko

    try:
        found = paramiko.SSHConfig.from_text(text).lookup(address)
    except (paramiko.ConfigParseError, ValueError, KeyError) as error:
        raise ConnectError(name, f"ssh_config cannot be read: {error}", hint="see what `ssh -G` says of it") from None
    # lookup() makes up a HostName when there is none; an earlier file or option must not lose against it.
    values: dict[str, Any] = dict(found)
    return {k: v if isinstance(v, list) else [v] for k, v in values.items() if v and (k, v) != ("hostname", address)}


def _ssh_g(name: str, address: str, given: Mapping[str, Sequence[str]], chosen: Path | None) -> dict[str, list[str]]:
    """Let OpenSSH resolve its own configuration; Match may depend on user and port, so they are given too."""
    command = ["ssh", "-G", *(["-F", str(chosen)] if chosen else [])]
    command += [f"-o{key}={value}" for key, values in given.items() for value in values]
    try:
        done = subprocess.run(
            [*command, "--", address], capture_output=True, text=True, timeout=10, stdin=subprocess.DEVNULL, check=False
        )
    except FileNotFoundError:
        hint = "install openssh-client, or write the configuration without Include and Match"
        raise ConnectError(name, "ssh_config uses Include or Match, and `ssh` is not installed", hint=hint) from None
    except subprocess.TimeoutExpired:
        raise ConnectError(name, "`ssh -G` took longer than 10 s", hint="is a `Match exec` waiting?") from None
    if done.returncode:
        raise ConnectError(name, f"`ssh -G {address}`: {done.stderr.strip()}", hint="correct ~/.ssh/config") from None
    found: dict[str, list[str]] = {}
    for line in done.stdout.splitlines():
        key, _, value = line.partition(" ")
        found.setdefault(key, []).append(value)
    # It lists its defaults like settings; a default is not a key that somebody configured.
    keys = found.get("identityfile", [])
    if all(os.path.dirname(k) == "~/.ssh" and os.path.basename(k) in _SSH_G_KEYS for k in keys):
        found.pop("identityfile", None)
    return {key: values for key, values in found.items() if key not in given}


def _settings(
    host: Host, config: Mapping[str, Sequence[str]], given: Mapping[str, Sequence[str]], chosen: Path | None
) -> SshSettings:
    """Type the values and expand what is in them."""

    def one(key: str, default: str = "") -> str:
        return config[key][0] if key in config else default

    hostname = one("hostname", host.address).replace("%h", host.address)
    user, port = one("user", getpass.getuser()), one("port", "22")
    if not port.isdigit():
        raise ConnectError(host.name, f"port {port!r} is not a number", hint="correct ansible_port or ssh_config")
    alias = one("hostkeyalias") or None
    tokens = _tokens(host.address, hostname, port, user, alias)

    def paths(key: str, default: str) -> tuple[str, ...]:
        return tuple(expand(w, tokens) for w in _words(one(key, default)) if w.lower() != "none")

    keys = tuple(expand(k, tokens) for k in config.get("identityfile", ()) if k.lower() != "none")
    checking = one("stricthostkeychecking", "yes").lower()
    jump = one("proxyjump")
    proxy = one("proxycommand")
    if proxy.lower() not in ("", "none"):
        _check_words(host.name, (hostname, host.address, user, alias or ""))
    return SshSettings(
        name=host.name,
        hostname=hostname,
        port=int(port),
        user=user,
        identity_files=keys or tuple(os.path.expanduser(f"~/.ssh/{name}") for name in _DEFAULT_KEYS),
        identities_configured=bool(keys),
        identities_only=one("identitiesonly").lower() == "yes",
        identity_agent=_agent(one("identityagent", "SSH_AUTH_SOCK"), tokens),
        password=host.password,
        known_hosts=paths("userknownhostsfile", "~/.ssh/known_hosts ~/.ssh/known_hosts2"),
        global_known_hosts=paths("globalknownhostsfile", "/etc/ssh/ssh_known_hosts /etc/ssh/ssh_known_hosts2"),
        host_key_alias=alias,
        accept_new=checking == "accept-new",
        asked_for_no=checking in ("no", "off", "false"),
        hash_known_hosts=one("hashknownhosts").lower() == "yes",
        proxy_jump=tuple(hop.strip() for hop in jump.split(",")) if jump and jump.lower() != "none" else (),
        proxy_command=None if proxy.lower() in ("", "none") else expand(proxy, tokens, tilde=False),
        address_family={"inet": socket.AF_INET, "inet6": socket.AF_INET6}.get(one("addressfamily"), socket.AF_UNSPEC),
        connect_timeout_s=float(t) if (t := one("connecttimeout")).isdigit() and int(t) > 0 else None,
        ssh_config=chosen,
        inherited=tuple(
            (key, given[key][0])
            for key in ("userknownhostsfile", "globalknownhostsfile", "stricthostkeychecking")
            if key in given
        ),
    )


def _check_words(name: str, words: Sequence[str]) -> None:
    """Refuse what would be more than a word in a ProxyCommand, which a shell runs; as OpenSSH does since 9.6.

    Raises:
        ConnectError: A host or user name holds what means something to a shell, or would be read as an option.
    """
    for word in words:
        if _NO_WORD.search(word):
            hint = "a ProxyCommand is run by a shell: correct ansible_host, ansible_user or ssh_config"
            raise ConnectError(name, f"{word[:80]!r} is no host or user name for a ProxyCommand", hint=hint)


def _agent(text: str, tokens: Mapping[str, str]) -> str | None:
    """Give the agent's socket for a value of IdentityAgent."""
    if text.lower() == "none":
        return None
    if text == "SSH_AUTH_SOCK" or text.startswith("$"):
        return os.environ.get("SSH_AUTH_SOCK" if text == "SSH_AUTH_SOCK" else text.strip("${}")) or None
    return expand(text.strip('"'), tokens)


def _tokens(address: str, hostname: str, port: str, user: str, alias: str | None) -> dict[str, str]:
    """Give ssh_config's %-tokens; the rare ones that need a lookup are left out."""
    node = socket.gethostname()
    return {
        "%%": "%", "%h": hostname, "%n": address, "%k": alias or address, "%p": port, "%r": user,
        "%u": getpass.getuser(), "%d": os.path.expanduser("~"), "%i": str(os.getuid()),
        "%L": node.split(".", maxsplit=1)[0], "%l": node,
    }  # fmt: skip


def expand(text: str, tokens: Mapping[str, str], *, tilde: bool = True) -> str:
    """Expand %-tokens, `${NAME}` of the environment (as ssh_config knows it) and a leading `~`."""
    text = re.sub(r"%.", lambda m: tokens.get(m.group(), m.group()), text)
    if not tilde:
        return text
    return os.path.expanduser(re.sub(r"\$\{(\w+)\}", lambda m: os.environ.get(m.group(1), m.group()), text))


def _words(text: str) -> list[str]:
    """Split a value of several words, some perhaps in quotes."""
    try:
        return shlex.split(text)
    except ValueError:
        return text.split()
