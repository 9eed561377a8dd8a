"""An sshd that shows another host key when it exchanges keys anew: who a robot is, is the key that was compared."""

from __future__ import annotations

import contextlib
import socket
import threading
from pathlib import Path
from typing import Any

import paramiko
from msgspec.structs import replace
from paramiko import common

from srprov.secret import Secret
from srprov.session import Traffic
from srprov.transport.openssh.connection import open_connection
from srprov.transport.openssh.way import set_out
from srprov.transport.options import ConnectOptions
from tests.impostors import in_place_of_sshd
from tests.unit.transport.waiting import wait_until


class _Robot(paramiko.ServerInterface):
    def check_auth_password(self, _user: str, _password: str) -> int:
        return common.AUTH_SUCCESSFUL


def test_no_other_key_is_taken_for_the_one_that_was_compared(tmp_path: Path) -> None:
    """It was the robot's from then on, and nobody had compared it with what is on record."""
    known, other, logged_in = paramiko.ECDSAKey.generate(), paramiko.ECDSAKey.generate(), threading.Event()

    def speak(taken: socket.socket) -> None:
        sshd = paramiko.Transport(taken)
        sshd.add_server_key(known)
        sshd.start_server(server=_Robot())
        logged_in.wait(20)
        sshd.add_server_key(other)  # in the place of the first, as it is of the same kind
        with contextlib.suppress(paramiko.SSHException, EOFError):
            sshd.renegotiate_keys()
        sshd.join(5)

    with in_place_of_sshd(speak) as host:
        record = tmp_path / "known_hosts"
        record.write_text(f"[127.0.0.1]:{host.port} {known.get_name()} {known.get_base64()}\n", encoding="ascii")
        no_key = ("identitiesonly", "yes"), ("identityfile", str(tmp_path / "none"))
        options = (("userknownhostsfile", str(record)), *no_key)
        there = replace(host, password=Secret("let me in"), ssh_options=options)
        connection = open_connection(set_out(there, ConnectOptions()), Traffic(), 1)
        try:
            logged_in.set()
            shown: Any = connection.transport
            wait_until(lambda: not shown.is_active() or shown.host_key == other, "the keys are exchanged")
            assert shown.host_key == known and not shown.is_active()
        finally:
            connection.close()
