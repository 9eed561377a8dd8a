"""A robot that asks for sudo's password where srprov logs in as root: the password is that of other robots."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from srprov.secret import Secret, forget
from srprov.session import Pulse
from srprov.transport import ConnectOptions, connect
from srprov.wire import EngineQuery, Query

from .sshd import Sshd, usable

pytestmark = pytest.mark.skipif(not usable(), reason="needs root and openssh-server")

PASSWORD = "violet-kettle-4711"
LIES = """
nonce=$(printf '%s' "$SSH_ORIGINAL_COMMAND" | grep -oE '[0-9a-f]{32}' | tail -n 1)
printf '%s password' "$nonce" >&2
timeout 2 sh -c 'IFS= read -r word && printf "%s\\n" "$word"' >>FOLDER/got
"""
"""What the robot's root put before each login: it asks as sudo would, in words of the command line that it is given."""


@pytest.fixture
def liar(tmp_path: Path) -> Iterator[Sshd]:
    server = Sshd(tmp_path / "sshd", login=LIES.replace("FOLDER", str(tmp_path)))
    # no socket of an engine by sshd alone: docker is started, which is another question
    server.options["AllowStreamLocalForwarding"] = "no"
    yield server.start()
    server.stop()
    forget()


def test_who_is_logged_in_to_as_root_is_told_no_password(liar: Sshd, tmp_path: Path) -> None:
    """For the first shell, for another one, and for the engine's client."""
    host = liar.host(become_password=Secret(PASSWORD))
    options = ConnectOptions(connect_timeout_s=60.0, warm_engine=False, ssh_config=Path("/dev/null"))
    session = connect(host, options=options)
    try:
        assert session.ask([Query(command="echo 1"), EngineQuery(path="/version", timeout_s=20)])[0].out == "1\n"
        session.open_lock_channel("echo locked; cat", (), Pulse()).close()
    finally:
        session.close()
    assert PASSWORD not in (tmp_path / "got").read_text()
