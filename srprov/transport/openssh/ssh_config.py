"""What ssh_config files say of an address.

Takes a name, an address and what was given by other means; reads the files and may start `ssh -G`. paramiko's parser
knows no Include and only part of Match: a configuration with one of them is resolved by OpenSSH itself.

Values are as they stand in the files, for `resolve.expand`: paramiko would expand tokens without the port and the user
that the inventory gives, and what a token stands for may look like another. What OpenSSH has expanded is `Settled`.
"""

from __future__ import annotations

import functools
import glob
import os
import re
import shlex
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import ConnectError

ADDS_UP = frozenset({"identityfile", "certificatefile"})
"""Keywords of which every value counts; of the others the first one wins."""
DEFAULT_KEYS = ("id_ed25519", "id_ecdsa", "id_rsa")

_BEYOND_PARAMIKO = re.compile(r"^[^\S\n]*(include|match)\b[^\S\n]*=?[^\S\n]*(.*)$", re.IGNORECASE | re.MULTILINE)
_WORD = re.compile(r"[\w.:@%+,=/][\w.:@%+,=/-]*")
"""What is one word to a shell, whatever lies in the folder at hand: no pattern of file names, too."""
_IN_COMMANDS = ("user", "hostname", "hostkeyalias")
"""Keywords whose values stand for %r, %h and %k in commands."""
_EXPANDED_BY_SOME = ("identityagent", "identityfile", "userknownhostsfile", "globalknownhostsfile", "revokedhostkeys")
"""Keywords whose values `ssh -G` shows as they stand in the file, or expanded; versions differ in that."""
_SSH_G_KEYS = frozenset({*DEFAULT_KEYS, "id_ecdsa_sk", "id_ed25519_sk", "id_xmss", "id_dsa"})


class Settled(str):
    """A value in which nothing is expanded any more: what looks like a token came in by one."""

    __slots__ = ()


def lookup(name: str, address: str, given: Mapping[str, Sequence[str]], chosen: Path | None) -> dict[str, list[str]]:
    """Return what the configuration files say about an address, by lower-case keyword."""
    texts = config_texts(chosen)
    if any(needs_openssh(text, file) for file, text in texts.items()):
        return _ssh_g(name, address, given, chosen)
    found: dict[str, list[str]] = {}
    for text in texts.values():
        for key, value in _parse(name, text, address).items():
            if key in ADDS_UP:
                found.setdefault(key, []).extend(value)
            else:
                found.setdefault(key, value)
    return found


def config_texts(chosen: Path | None) -> dict[Path, str]:
    """Return the configuration files that exist, the first to win first; raises OSError for one that cannot be read."""
    files = [chosen] if chosen else [Path("~/.ssh/config").expanduser(), Path("/etc/ssh/ssh_config")]
    return {file: _text(file, os.stat(file).st_mtime_ns) for file in files if file.is_file()}


@functools.lru_cache(maxsize=8)
def _text(file: Path, _mtime_ns: int) -> str:
    """Read one configuration file, once per version of it."""
    return regular_file.read_text(file, errors="replace")


def needs_openssh(text: str, file: Path) -> bool:
    """Tell whether paramiko's parser would misread a text. An Include that names no existing file does no harm."""
    for keyword, rest in _BEYOND_PARAMIKO.findall(text):
        if keyword.lower() == "match":
            return True
        base = file.parent if file.parent == Path("/etc/ssh") else Path("~/.ssh").expanduser()
        if any(glob.glob(str(base / Path(word).expanduser())) for word in words(rest)):
            return True
    return False


def _parse(name: str, text: str, address: str) -> dict[str, list[str]]:
    """Look an address up in a simple ssh_config."""
    import paramiko

    class Raw(paramiko.SSHConfig):
        TOKENS_BY_CONFIG_KEY: dict[str, list[str]] = {}  # noqa: RUF012 - as its stub has it

    try:
        found = Raw.from_text(text).lookup(address)
    except (paramiko.ConfigParseError, ValueError, KeyError) as error:
        raise ConnectError(
            name, f"ssh_config cannot be read: {error}", hint="see what `ssh -G` says of it", code=Code.SSH_CONFIG
        ) from None
    # lookup() makes up a HostName when there is none; an earlier file or option must not lose against it.
    values: dict[str, Any] = dict(found)
    if "proxycommand" in values:
        values["proxycommand"] = values["proxycommand"] or "none"  # that is None there; a later file must not win
    return {k: v if isinstance(v, list) else [v] for k, v in values.items() if v and (k, v) != ("hostname", address)}


def _ssh_g(name: str, address: str, given: Mapping[str, Sequence[str]], chosen: Path | None) -> dict[str, list[str]]:
    """Let OpenSSH resolve its own configuration; Match may depend on user and port, so they are given too."""
    said = [address, *(word for key in _IN_COMMANDS for word in given.get(key, ()))]
    check_words(name, said)
    check_parts(name, said)
    settings = [f"{key}={value}" for key, values in given.items() if key not in ADDS_UP for value in values]
    _check_lines(name, settings)
    arguments = [*(["-F", os.path.abspath(chosen)] if chosen else []), *(f"-o{one}" for one in settings), "--", address]
    try:
        found = _answer(arguments)
        doubtful = [value for key in _EXPANDED_BY_SOME for value in found.get(key, ())]
        expanded = {"hostname", *(_expanded() if set("%$") & set("".join(doubtful)) else ())}
    except FileNotFoundError:
        hint = "install openssh-client, or write the configuration without Include and Match"
        raise ConnectError(
            name, "ssh_config uses Include or Match, and `ssh` is not installed", hint=hint, code=Code.SSH_CONFIG
        ) from None
    except subprocess.TimeoutExpired:
        wrong, hint = "its ssh configuration was not read within 10 s, by `ssh -G`", "is a `Match exec` waiting?"
        raise ConnectError(name, wrong, hint=hint, code=Code.SSH_CONFIG) from None
    except ValueError as error:
        wrong = f"its ssh configuration cannot be used: {error} (of `ssh -G {address}`)"
        raise ConnectError(name, wrong, hint="correct ~/.ssh/config", code=Code.SSH_CONFIG) from None
    # It lists its defaults like settings; a default is not a key that somebody configured.
    keys = found.get("identityfile", [])
    if all(os.path.dirname(k) == "~/.ssh" and os.path.basename(k) in _SSH_G_KEYS for k in keys):
        found.pop("identityfile", None)
    found = {key: values for key, values in found.items() if key in ADDS_UP or key not in given}
    return {key: [Settled(one) for one in some] if key in expanded else some for key, some in found.items()}


def _answer(arguments: Sequence[str]) -> dict[str, list[str]]:
    """Return what `ssh -G` says.

    Raises:
        OSError: It cannot be started.
        subprocess.TimeoutExpired: It took more than 10 s.
        ValueError: It failed; with its words.
    """
    done = subprocess.run(
        ["ssh", "-G", *arguments],
        capture_output=True, text=True, timeout=10, stdin=subprocess.DEVNULL, check=False,
        cwd="/",  # `Match exec` runs there: the folder at hand may be a stranger's
    )  # fmt: skip
    if done.returncode:
        raise ValueError(done.stderr.strip())
    found: dict[str, list[str]] = {}
    for line in filter(None, done.stdout.split("\n")):  # other ends of lines are parts of values
        key, _, value = line.partition(" ")
        found.setdefault(key, []).append(value)
    return found


@functools.lru_cache(maxsize=1)
def _expanded() -> frozenset[str]:
    """Return the keywords whose values this machine's `ssh -G` shows expanded; it is asked once, as `_answer`."""
    found = _answer(["-F", "/dev/null", "-oIgnoreUnknown=*", *(f"-o{key}=%%" for key in _EXPANDED_BY_SOME), "--", "x"])
    return frozenset(key for key in _EXPANDED_BY_SOME if found.get(key) == ["%"])


def _check_lines(name: str, settings: Iterable[str]) -> None:
    """Refuse what is more than one line: `ssh -G` prints it as it is, and each line of its answer is a setting."""
    for setting in settings:
        if not setting.isprintable():
            wrong = f"{setting[:80]!r} is no setting of ssh: a control character is in it"
            raise ConnectError(name, wrong, hint="correct the inventory", code=Code.SSH_CONFIG)


def check_words(name: str, words: Iterable[str]) -> None:
    """Refuse what would be more than a word in a ProxyCommand or `Match exec`, run by a shell; as OpenSSH since 9.6.

    Raises:
        ConnectError: A host or user name holds what means something to a shell, or would be read as an option.
    """
    for word in words:
        if word and not _WORD.fullmatch(word):
            hint = "ProxyCommand and Match exec are run by a shell: correct ansible_host, ansible_user or ssh_config"
            raise ConnectError(
                name, f"{word[:80]!r} is no host or user name for a command", hint=hint, code=Code.SSH_CONFIG
            )


def check_parts(name: str, words: Iterable[str]) -> None:
    """Refuse what would be more than a part of a path, as `UserKnownHostsFile ~/.ssh/known/%r` has it, or an option.

    Raises:
        ConnectError: A host or user name has a slash, begins with `-`, or is all that leads to another folder.
    """
    for word in words:
        if "/" in word or word in (".", "..") or word.startswith("-"):
            why = "it has a slash" if "/" in word else "it leads to another folder"
            why = "it begins with '-'" if word.startswith("-") else why
            hint = "ssh_config may put it into the name of a file: correct ansible_host, ansible_user or ssh_config"
            raise ConnectError(name, f"{word[:80]!r} is no host or user name: {why}", hint=hint, code=Code.SSH_CONFIG)


def words(text: str) -> list[str]:
    """Split a value of several words, some perhaps in quotes; of a settled one, each is settled."""
    try:
        found = shlex.split(text)
    except ValueError:
        found = text.split()
    return [type(text)(word) for word in found]
