"""An sshd whose messages cannot be read: one robot's failure, in words, whatever paramiko's reader stumbles over."""

from __future__ import annotations

import contextlib
import socket
import threading
from pathlib import Path

import paramiko
import pytest
from paramiko import common

from srprov.definitions.model import Host
from srprov.errors import TransportError
from srprov.secret import Secret
from srprov.transport import connect
from srprov.transport.options import ConnectOptions

NO_TEXT = b"\xff\xfe"


def _said(kind: bytes, begin: bytes, *texts: bytes) -> paramiko.Message:
    message = paramiko.Message()
    message.add_bytes(kind + begin)
    for text in texts:
        message.add_string(text)
    return message


MOMENTS = {
    "key exchange": (common.cMSG_KEXINIT, lambda _: _said(common.cMSG_KEXINIT, b"\0" * 16, NO_TEXT)),
    "login": (common.cMSG_USERAUTH_SUCCESS, lambda _: _said(common.cMSG_USERAUTH_FAILURE, b"", NO_TEXT)),
    "many words": (
        common.cMSG_USERAUTH_SUCCESS,
        lambda _: _said(common.cMSG_USERAUTH_FAILURE, b"", b"hostbased,x," + b"B" * 200_000),
    ),
    "goodbye": (common.cMSG_USERAUTH_SUCCESS, lambda _: _said(common.cMSG_DISCONNECT, b"\0\0\0\1", NO_TEXT)),
    "session": (
        common.cMSG_CHANNEL_OPEN_SUCCESS,
        lambda was: _said(common.cMSG_CHANNEL_OPEN_FAILURE, was[1:5] + b"\0\0\0\1", NO_TEXT, b""),
    ),
    "command": (common.cMSG_CHANNEL_SUCCESS, lambda was: _said(common.cMSG_CHANNEL_REQUEST, was[1:5], NO_TEXT)),
}
"""Which message of an sshd is sent as another one."""


class _Robot(paramiko.ServerInterface):
    def check_auth_password(self, _user: str, _password: str) -> int:
        return common.AUTH_SUCCESSFUL

    def check_channel_request(self, _kind: str, _number: int) -> int:
        return common.OPEN_SUCCEEDED

    def check_channel_exec_request(self, _channel: paramiko.Channel, _command: bytes) -> bool:
        return True


class _Sshd(paramiko.Transport):
    moment = ""

    def _send_message(self, message: paramiko.Message) -> None:
        kind, instead = MOMENTS[self.moment]
        was = message.asbytes()
        super()._send_message(instead(was) if was.startswith(kind) else message)  # type: ignore[misc]


@pytest.mark.parametrize("moment", [one for one in MOMENTS if one != "many words"])
def test_text_that_is_none_is_one_robot_s_failure(moment: str, tmp_path: Path) -> None:
    """It was raised as it came, and ended the run of all robots as a bug."""
    words = r"a message of its sshd cannot be read|password; the robot closed"
    with pytest.raises(TransportError, match=words) as caught:
        _connect_to(moment, tmp_path)
    assert caught.value.host == "r1"


def test_what_a_robot_wants_for_a_login_is_told_in_short(tmp_path: Path) -> None:
    """All of it was in the error, for each key that was tried."""
    with pytest.raises(TransportError, match="the robot wants hostbased or x") as caught:
        _connect_to("many words", tmp_path)
    assert len(str(caught.value)) < 1000


def _connect_to(moment: str, folder: Path) -> None:
    """Connect to an sshd that says something odd."""
    server = socket.create_server(("127.0.0.1", 0))
    key = paramiko.ECDSAKey.generate()

    def serve() -> None:
        with contextlib.suppress(OSError, EOFError, paramiko.SSHException):
            taken, _ = server.accept()
            sshd = _Sshd(taken)
            sshd.moment = moment
            sshd.add_server_key(key)
            sshd.start_server(server=_Robot())
            kept = sshd.accept(5)
            sshd.join(5)
            del kept

    threading.Thread(target=serve, daemon=True).start()
    known = folder / "known_hosts"
    known.write_text(f"[127.0.0.1]:{server.getsockname()[1]} {key.get_name()} {key.get_base64()}\n")
    options = (("userknownhostsfile", str(known)), ("identitiesonly", "yes"), ("identityfile", str(folder / "none")))
    host = Host(
        name="r1", address="127.0.0.1", port=server.getsockname()[1], user="root", password=Secret("x" * 8),
        ssh_options=options,
    )  # fmt: skip
    with server:
        connect(host, options=ConnectOptions(attempts=1, connect_timeout_s=10))
