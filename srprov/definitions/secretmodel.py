"""The values that `secrets` become: where one comes from, and where a container sees it. Never what it is."""

from __future__ import annotations

import shlex

import msgspec

from srprov.errors import Location

_NOWHERE = Location("")
_GONE_BY = frozenset({
    "HOME", "PATH", "PWD", "TMPDIR", "TEMP", "TMP", "USER", "LOGNAME", "LNAME", "USERNAME", "SUDO_UID", "PKEXEC_UID",
    "SSH_AUTH_SOCK", "DOCKER_HOST", "TERM", "NO_COLOR",
})  # fmt: skip


def is_gone_by(variable: str) -> bool:
    """Return whether srprov itself goes by a variable: where it keeps what it knows, who its user is.

    None is a secret. As the variable of one it would leave the environment, and what is kept would lie elsewhere.
    """
    return variable in _GONE_BY or variable.startswith(("XDG_", "SRPROV_"))


class SecretSource(msgspec.Struct, frozen=True, kw_only=True):
    """Where the value of a secret comes from; exactly one of `env`, `file`, `command` is not empty."""

    name: str
    env: str = ""
    file: str = ""
    """Absolute path on the controller."""
    command: tuple[str, ...] = ()
    folder: str = ""
    """Where the command runs: the EDF's folder."""
    location: Location = _NOWHERE
    excerpt: str = ""
    """The line of the EDF, for error messages."""

    @property
    def kind(self) -> str:
        """Return which permission it takes: a program here, in a folder of a stranger's, is more than a value."""
        return "secret-command" if self.command else "secret"

    @property
    def origin(self) -> str:
        """Return where it comes from, as plans and permissions show it."""
        if self.command:
            # which program that is, and which files it names, depends on where it runs, which a plan file says itself
            return f"the command {shlex.join(self.command)}" + (f", in {self.folder}" if self.folder else "")
        return f"the variable {self.env}" if self.env else f"the file {self.file}"


class SecretUse(msgspec.Struct, frozen=True, kw_only=True):
    """A secret in a service's container."""

    source: str
    """The secret's name."""
    target: str
    """Absolute path inside."""
    mode: str = "0400"
    """Octal text, four digits."""
