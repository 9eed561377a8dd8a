"""How one host is reached: inventory, `-o` options and ssh_config become one `SshSettings`.

Takes a `Host`, returns a frozen value. The order is OpenSSH's: what the inventory names, then its `-o` options, then
~/.ssh/config, then /etc/ssh/ssh_config; the first value wins, IdentityFile adds up.
"""

from __future__ import annotations

import getpass
import os
import re
import socket
from collections.abc import Mapping, Sequence
from pathlib import Path

from srprov.codes import Code
from srprov.definitions.model import Host
from srprov.errors import ConnectError
from srprov.secret import MASK
from srprov.transport.openssh.settings import SshSettings
from srprov.transport.openssh.ssh_config import ADDS_UP, DEFAULT_KEYS, Settled, check_parts, check_words, lookup, words

_PORTS = 1 << 16
_OF_JUMP_HOSTS_TOO = ("userknownhostsfile", "globalknownhostsfile", "stricthostkeychecking")


def resolve(host: Host, *, ssh_config: Path | None = None) -> SshSettings:
    """Find out how to reach a host.

    Raises:
        ConnectError: ssh_config cannot be read or resolved, or names a file by what there is not.
    """
    given = _first_wins(host)
    config = lookup(host.name, host.address, given, ssh_config)
    for key, values in given.items():
        config[key] = [*values, *config.get(key, [])] if key in ADDS_UP else values
    inherited = tuple((key, given[key][0]) for key in _OF_JUMP_HOSTS_TOO if key in given)
    try:
        return _settings(
            host, _Config({key: values for key, values in config.items() if values}), ssh_config, inherited
        )
    except ValueError as error:
        hint = "correct the names of files in ssh_config, or in the inventory's arguments for ssh"
        raise ConnectError(
            host.name, f"its ssh configuration names a file, and {error}", hint=hint, code=Code.SSH_CONFIG
        ) from None


def _first_wins(host: Host) -> dict[str, list[str]]:
    """Return what the inventory says, its own variables before its `-o` options."""
    own = (("port", host.port), ("user", host.user), ("identityfile", host.identity_file))
    given: dict[str, list[str]] = {key: [str(value)] for key, value in own if value}
    for key, value in host.ssh_options:
        if key in ADDS_UP:
            given.setdefault(key, []).append(value)
        else:
            given.setdefault(key, [value])
    return given


class _Config:
    """Values by lower-case keyword."""

    def __init__(self, values: Mapping[str, Sequence[str]]) -> None:
        self.every = values

    def one(self, key: str, default: str = "") -> str:
        """Return the value that wins."""
        return self.every[key][0] if key in self.every else default

    def chosen(self, key: str) -> str:
        """Return the value that wins; nothing for the word `none`."""
        value = self.one(key)
        return "" if value.lower() == "none" else value

    def yes(self, key: str) -> bool:
        """Tell whether the value is `yes`."""
        return self.one(key).lower() == "yes"


def _check_known(name: str, command: str) -> None:
    """Refuse a command that a record hides: for a shell it is all files of the folder at hand, the first a program."""
    if MASK in command:
        wrong = f"its ProxyCommand is {MASK}, as the inventory of a record has it"
        raise ConnectError(name, wrong, hint="name the inventory of that time with -i", code=Code.SSH_CONFIG)


def _check_port(name: str, port: str) -> None:
    if not re.fullmatch("[0-9]{1,5}", port) or not 0 < int(port) < _PORTS:
        wrong, hint = f"port {port!r} is not within 1 to 65535", "correct ansible_port or ssh_config"
        raise ConnectError(name, wrong, hint=hint, code=Code.SSH_CONFIG)


def _settings(
    host: Host, config: _Config, ssh_config: Path | None, inherited: tuple[tuple[str, str], ...]
) -> SshSettings:
    """Type the values and expand what is in them."""
    hostname = _hostname(host.address, config)
    user, port = config.one("user", getpass.getuser()), config.one("port", "22")
    _check_port(host.name, port)
    alias, proxy = config.one("hostkeyalias") or None, config.chosen("proxycommand")
    names = (hostname, host.address, user, alias or "")
    check_parts(host.name, names)
    if proxy:
        check_words(host.name, names)
        _check_known(host.name, proxy)
    tokens = _tokens(host.address, hostname, port, user, alias)
    keys = _paths(config.every.get("identityfile", ()), tokens)
    checking, timeout = config.one("stricthostkeychecking", "yes").lower(), config.one("connecttimeout")
    return SshSettings(
        name=host.name,
        address=host.address,
        hostname=hostname,
        port=int(port),
        user=user,
        identity_files=keys or tuple(os.path.expanduser(f"~/.ssh/{name}") for name in DEFAULT_KEYS),
        identities_configured=bool(keys),
        identities_only=config.yes("identitiesonly"),
        identity_agent=_agent(config.one("identityagent", "SSH_AUTH_SOCK"), tokens),
        password=host.password,
        known_hosts=_paths(words(config.one("userknownhostsfile", "~/.ssh/known_hosts ~/.ssh/known_hosts2")), tokens),
        global_known_hosts=_paths(
            words(config.one("globalknownhostsfile", "/etc/ssh/ssh_known_hosts /etc/ssh/ssh_known_hosts2")), tokens
        ),
        revoked_host_keys=expand(_unquoted(config.chosen("revokedhostkeys")), tokens) or None,
        host_key_alias=alias,
        accept_new=checking == "accept-new",
        asked_for_no=checking in ("no", "off", "false"),
        hash_known_hosts=config.yes("hashknownhosts"),
        proxy_jump=_hops(host.name, config.chosen("proxyjump"), tokens, names),
        proxy_command=expand(proxy, tokens, tilde=False) if proxy else None,
        address_family={"inet": socket.AF_INET, "inet6": socket.AF_INET6}.get(
            config.one("addressfamily"), socket.AF_UNSPEC
        ),
        connect_timeout_s=float(timeout) if re.fullmatch("[1-9][0-9]{0,6}", timeout) else None,
        ssh_config=ssh_config,
        inherited=inherited,
    )


def _hostname(address: str, config: _Config) -> str:
    """Return the name that is connected to; HostName knows two tokens, and an address none."""
    return expand(config.one("hostname", Settled(address)), {"%h": address, "%%": "%"}, tilde=False)


def _paths(values: Sequence[str], tokens: Mapping[str, str]) -> tuple[str, ...]:
    """Expand the names of files; `none` is none."""
    return tuple(expand(value, tokens) for value in values if value.lower() != "none")


def _hops(name: str, text: str, tokens: Mapping[str, str], names: Sequence[str]) -> tuple[str, ...]:
    """Return the jump hosts of a value of ProxyJump, which may be named by tokens."""
    if "%" in text:
        check_words(name, names)
        if several := next((one for one in names if "," in one), ""):
            hint = "ssh_config puts it into ProxyJump: correct ansible_host, ansible_user or ssh_config"
            raise ConnectError(name, f"{several[:80]!r} is no part of a jump host", hint=hint, code=Code.SSH_CONFIG)
    return tuple(expand(hop.strip(), tokens, tilde=False) for hop in text.split(",") if hop.strip())


def _unquoted(text: str) -> str:
    return type(text)(text.strip('"'))


def _agent(text: str, tokens: Mapping[str, str]) -> str | None:
    """Return the agent's socket for a value of IdentityAgent."""
    if text.lower() == "none":
        return None
    if text == "SSH_AUTH_SOCK" or (text.startswith("$") and re.fullmatch(r"\$(\w+|\{\w+\})", text)):
        return os.environ.get("SSH_AUTH_SOCK" if text == "SSH_AUTH_SOCK" else text.strip("${}")) or None
    return expand(_unquoted(text), tokens)


def _tokens(address: str, hostname: str, port: str, user: str, alias: str | None) -> dict[str, str]:
    """Return ssh_config's %-tokens; the rare ones that need a lookup are left out."""
    node = socket.gethostname()
    return {
        "%%": "%", "%h": hostname, "%n": address, "%k": alias or address, "%p": port, "%r": user,
        "%u": getpass.getuser(), "%d": os.path.expanduser("~"), "%i": str(os.getuid()),
        "%L": node.split(".", maxsplit=1)[0], "%l": node,
    }  # fmt: skip


def expand(text: str, tokens: Mapping[str, str], *, tilde: bool = True) -> str:
    """Expand %-tokens, `${NAME}` of the environment (as ssh_config knows it) and a leading `~`.

    In one pass, and never in a value that is settled: what a token stands for may be a stranger's word, such as a user
    in an inventory; it is taken as it is, and so is the path of a home.

    Raises:
        ValueError: There is no such variable, or no such user: the name of a file would begin in the folder at hand.
    """
    if isinstance(text, Settled):
        return str(text)

    def value(found: re.Match[str]) -> str:
        if found[1] is None:
            return tokens.get(found[0], found[0])
        if tilde and found[1] not in os.environ:
            raise ValueError(f"the variable {found[1]} is not set")
        return os.environ[found[1]] if tilde else found[0]

    first, slash, rest = text.partition("/") if tilde and text.startswith("~") else ("", "", text)
    home = os.path.expanduser(first)
    if home.startswith("~"):
        raise ValueError(f"there is no user {first[1:]}")
    return (home.rstrip("/") if slash else home) + slash + re.sub(r"%.|\$\{(\w+)\}", value, rest)
