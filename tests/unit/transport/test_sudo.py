"""Becoming root with a password: told to sudo when it asks, on its standard input, and to nobody else."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.definitions.model import Host
from srprov.errors import AuthError
from srprov.secret import Secret, Vault, forget
from srprov.transport import ConnectOptions
from srprov.transport.local_session import LocalSession
from srprov.transport.shell.frames import start_command, sudo_prompt
from srprov.wire import Put, Query, Run

PASSWORD = 'it\'s "a" $(word)'
SUDO = """#!/bin/sh
# asks as sudo does: with its prompt on standard error, up to three times
echo "$*" >> "{folder}/argv"
[ -e "{folder}/free" ] && while [ "$1" != sh ]; do shift; done && exec "$@"
[ "$1" = -n ] && {{ echo "sudo: a password is required" >&2; exit 1; }}
[ "$1 $2" = "-S -p" ] || exit 9
prompt=$3
shift 3
for try in 1 2 3; do
    echo "We trust you have received the usual lecture" >&2
    printf %s "$prompt" >&2
    IFS= read -r word || exit 1
    echo "$word" >> "{folder}/tries"
    [ "$word" = "$(cat "{folder}/password")" ] && exec "$@"
    echo "Sorry, try again." >&2
done
exit 1
"""


@pytest.fixture
def bin_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Make this process a user who is not root, with a sudo that wants PASSWORD; give where it keeps its notes."""
    (tmp_path / "sudo").write_text(SUDO.format(folder=tmp_path))
    (tmp_path / "id").write_text("#!/bin/sh\necho 1000\n")
    (tmp_path / "password").write_text(PASSWORD)
    for name in ("sudo", "id"):
        (tmp_path / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    yield tmp_path
    forget()


def opened(password: str | None) -> LocalSession:
    """Open a session with this machine."""
    secret = None if password is None else Secret(password)
    host = Host(name="here", address="here", connection="local", become_password=secret)
    return LocalSession.open(host, ConnectOptions(connect_timeout_s=20, warm_engine=False))


def test_the_password_is_told_when_sudo_asks(bin_folder: Path) -> None:
    """Once, by standard input; the shell works then, and has the password in no argument."""
    session = opened(PASSWORD)
    try:
        assert session.ask([Query(command="echo $((6 * 7))")])[0].out == "42\n"
        assert session.execute(Run(script="echo done")).ok
    finally:
        session.close()
    assert (bin_folder / "tries").read_text() == PASSWORD + "\n"
    assert PASSWORD not in (bin_folder / "argv").read_text()


def test_a_sudo_that_asks_nothing_is_told_nothing(bin_folder: Path) -> None:
    """The password must not become the first command of the root shell."""
    (bin_folder / "free").touch()
    session = opened(PASSWORD)
    try:
        reply = session.ask([Query(command="cat /proc/$PPID/comm; echo fine")])[0]
    finally:
        session.close()
    assert reply.out.endswith("fine\n") and reply.err == ""
    assert not (bin_folder / "tries").exists()


def test_a_wrong_password_is_tried_once(bin_folder: Path) -> None:
    """Another try might lock the account; the error names user and remedy, and no password."""
    with pytest.raises(AuthError, match="sudo does not accept the password") as caught:
        opened("wrong-password")
    assert (bin_folder / "tries").read_text() == "wrong-password\n"
    assert "wrong-password" not in f"{caught.value.message} {caught.value.hint}"
    assert "--ask-become-pass" in caught.value.hint


def test_without_a_password_sudo_is_not_asked_for_one(bin_folder: Path) -> None:
    """It says so itself, and the hint names both ways out."""
    with pytest.raises(AuthError, match="a password is required") as caught:
        opened(None)
    assert "NOPASSWD" in caught.value.hint and "ansible_become_password" in caught.value.hint
    assert not (bin_folder / "tries").exists()


@pytest.mark.parametrize("login", ["sh", "bash"])
def test_the_command_line_holds_a_prompt_only(bin_folder: Path, login: str) -> None:
    """What a robot's login shell gets to see is the same for every password."""
    line = start_command("abc123", "sh", root=False, ask=True)
    assert sudo_prompt("abc123").decode() in line and PASSWORD not in line
    done = subprocess.run([login, "-c", line], input=f"{PASSWORD}\necho $$ up\n", capture_output=True, text=True)
    assert done.stdout.endswith(" up\n")
    assert "abc123 password" in done.stderr


def test_a_secret_put_shows_a_placeholder_when_the_connection_dies() -> None:
    """The error of a lost connection quotes a command by its first characters: never those of a value."""
    host = Host(name="here", address="here", connection="local")
    vault = Vault({"t": Secret("hunter2-lost")})
    session = LocalSession.open(host, ConnectOptions(connect_timeout_s=20, warm_engine=False, vault=vault))
    put = Put(path="/run/x", secret="t", mode=0o400)
    script = session._script(put)
    assert "aHVudGVyMi1sb3N0" in script
    with pytest.raises(Exception, match="<secret t>") as caught:
        session._shell.run(put, "kill -9 $$; sleep 1", lambda _line: None)
    session.close()
    assert "kill" not in str(caught.value)
    forget()
