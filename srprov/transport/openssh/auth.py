"""Logging in: which keys are tried, in which order, and the error that names them when none was accepted.

Takes `SshSettings` and a paramiko transport after its key exchange; reads key files and asks the agent. Order:
configured identity files (through the agent where the file is encrypted), then, unless IdentitiesOnly, the other keys
of the agent; without a configured key the agent comes first and then ~/.ssh/id_*; a password last. sshd closes after
six wrong keys (MaxAuthTries), which is why a configured key is never preceded by guesses.
"""

from __future__ import annotations

import contextlib
import functools
import os
import re
import socket
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import paramiko
from paramiko.auth_strategy import AuthResult, AuthStrategy

from srprov import regular_file
from srprov.codes import Code
from srprov.errors import AuthError, ConnectError, DeadlineError
from srprov.transport.deadline import Deadline
from srprov.transport.openssh.settings import SshSettings
from srprov.wire import quote

_LARGEST_KEY = 16 * 1024
_METHOD = re.compile(r"[a-z0-9][a-z0-9@.-]{0,63}")
_MOST_METHODS = 8
Attempt = tuple[str, str, Callable[[paramiko.Transport], list[str]]]
"""Method, what is offered in words, and a function that offers it and returns what the robot wants besides."""


@functools.lru_cache(maxsize=64)
def _load(path: str, _mtime_ns: int) -> paramiko.PKey:
    """Read a private key, with its certificate when one lies beside it; once per file, for all robots."""
    for one in (path, f"{path}-cert.pub"):
        if os.path.exists(one):
            regular_file.read(one, _LARGEST_KEY)  # paramiko would wait for a pipe for ever
    return paramiko.PKey.from_path(path)


def load_key(path: str) -> paramiko.PKey:
    """Read a private key without a passphrase; raises what paramiko and cryptography raise for one they cannot use."""
    return _load(path, os.stat(path).st_mtime_ns)


class Agent(paramiko.agent.AgentSSH):
    """The keys of an SSH agent at a given socket; paramiko's own class only knows SSH_AUTH_SOCK."""

    def __init__(self, path: str | None) -> None:
        """Ask the agent for its keys; no agent is an agent without keys."""
        super().__init__()
        if not path:
            return
        with contextlib.suppress(OSError, paramiko.SSHException):
            conn = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            conn.settimeout(30)  # a hardware key waits for a touch
            conn.connect(path)
            self._connect(conn)  # type: ignore[attr-defined]  # the stubs leave out what its subclasses are to call

    def close(self) -> None:
        """End the connection to the agent."""
        self._close()  # type: ignore[attr-defined]


@dataclass
class Login(AuthStrategy):
    """One attempt to log in; `tried` says in words what was offered."""

    settings: SshSettings
    deadline: Deadline
    tried: list[str] = field(default_factory=list)

    def get_sources(self) -> Iterator[Any]:
        """Return none: `authenticate` replaces the base class's loop, which goes on after the connection is lost."""
        return iter(())

    def authenticate(self, transport: Any) -> AuthResult:  # noqa: ANN401 - paramiko.Transport, as the base class has it
        """Try everything until the robot is content.

        Raises:
            AuthError: Nothing was accepted.
            DeadlineError: The robot did not answer in time.
            ConnectError: The connection was lost meanwhile.
        """
        allowed: list[str] = []
        agent = Agent(self.settings.identity_agent)
        try:
            for method, label, attempt in self._attempts(agent):
                asked = {*allowed, "password"} if "keyboard-interactive" in allowed else allowed
                if asked and method not in asked:
                    continue
                transport.auth_timeout = self.deadline.left(0.1)
                try:
                    more = attempt(transport)
                except paramiko.BadAuthenticationType as error:
                    allowed = _methods(error.allowed_types)
                    self.tried.append(f"{label} (not accepted: the robot wants {_either(allowed, 'or')})")
                except paramiko.SSHException as error:
                    self._failed(transport, label, error)
                else:
                    if not more:
                        return AuthResult(strategy=self)
                    allowed = _methods(more)
                    self.tried.append(f"{label} (accepted, but the robot also wants {_either(allowed, 'and')})")
        finally:
            agent.close()
        raise self._error("")

    def _failed(self, transport: paramiko.Transport, label: str, error: Exception) -> None:
        """Note a refused attempt; raise when there is nobody left to try another one with."""
        self.tried.append(label)
        if self.deadline.passed or "timeout" in str(error).lower():
            raise DeadlineError(
                self.settings.name,
                f"the login did not finish within {self.deadline.seconds:g} s ({label})",
                hint="is the robot overloaded, or its sshd waiting for a name server (UseDNS)?",
            )
        if not transport.is_active():
            if len(self.tried) > 1:
                raise self._error("; the robot closed the connection after that (MaxAuthTries?)")
            raise ConnectError(
                self.settings.name, f"connection lost during the login: {error}", hint="try again", code=Code.LOST
            )

    def _attempts(self, agent: Agent) -> Iterator[Attempt]:
        """Return (method, label, attempt) in the order of the module's description."""
        settings, user = self.settings, self.settings.user
        offered: set[bytes] = set()

        def public(key: paramiko.PKey, label: str) -> Iterator[Attempt]:
            if key.asbytes() not in offered:
                offered.add(key.asbytes())
                yield "publickey", label, lambda transport: transport.auth_publickey(user, key)

        def of_agent() -> Iterator[Attempt]:
            for key in agent.get_keys():
                yield from public(key, f"agent key {key.comment or key.fingerprint}")

        if not settings.identities_configured and not settings.identities_only:
            yield from of_agent()
        for path in settings.identity_files:
            if key := self._key(path, agent):
                yield from public(key, path)
        if settings.identities_configured and not settings.identities_only:
            yield from of_agent()
        if settings.password is not None:
            secret = settings.password
            yield "password", "password", lambda transport: transport.auth_password(user, secret.reveal())

    def _key(self, path: str, agent: Agent) -> paramiko.PKey | None:
        """Read an identity file, or find it in the agent; one that cannot be used is noted."""
        try:
            return load_key(path)
        except Exception as error:  # OSError, ValueError, TypeError, and three libraries' own kinds for unknown keys
            why = error
        blobs = {_public_part(path + ".pub"), _public_part(path)}
        for key in agent.get_keys():
            if key.get_base64() in blobs:
                return key
        if self.settings.identities_configured or not isinstance(why, FileNotFoundError):
            self.tried.append(f"{path} ({_why(why)})")
        return None

    def _error(self, more: str) -> AuthError:
        """Name the user and all that was offered."""
        user, name = self.settings.user, self.settings.name
        login = quote(f"{user}@{self.settings.hostname}")
        tried = ", ".join(self.tried) or "no key was found"
        return AuthError(
            name,
            f"login as {user!r} was refused; tried: {tried}{more}",
            hint=(
                f"put a key there (ssh-copy-id {login}), or name the right one "
                "(ansible_ssh_private_key_file) or the right user (ansible_user)"
            ),
        )


def _methods(said: Iterable[str]) -> list[str]:
    """Return the ways to log in that a robot names; it may say 256 KiB of anything."""
    return [one for one in said if _METHOD.fullmatch(one)][:_MOST_METHODS]


def _either(methods: Sequence[str], word: str) -> str:
    return f" {word} ".join(methods) or "what nobody knows"


def _public_part(path: str) -> str:
    """Return the base64 of a public key file, or nothing."""
    with contextlib.suppress(OSError, IndexError):
        return regular_file.read_text(path, _LARGEST_KEY).split()[1]
    return ""


def _why(error: Exception) -> str:
    """Say why a key file was of no use."""
    if isinstance(error, FileNotFoundError):
        return "no such file"
    if isinstance(error, PermissionError):
        return "not readable"
    if isinstance(error, (TypeError, paramiko.PasswordRequiredException)) or "password" in str(error).lower():
        return "encrypted, and not in the agent: ssh-add it"
    return "not a private key that can be used"
