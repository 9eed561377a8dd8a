"""The first part of the way to a robot: its sshd is dialled before paramiko is imported."""

from __future__ import annotations

import socket
import subprocess
import sys

import pytest

from srprov import transport
from srprov.definitions.model import Host
from srprov.transport import ConnectOptions
from srprov.transport.openssh.way import set_out


class Imported(Exception):
    """Raised where paramiko would be imported."""


def test_sshd_is_dialled_before_paramiko_is_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(5)

        def preload() -> None:
            server.accept()[0].close()
            raise Imported

        monkeypatch.setattr(transport, "preload_ssh", preload)
        with pytest.raises(Imported):
            transport.connect(Host(name="r1", address="127.0.0.1", port=server.getsockname()[1]))


def test_what_dials_does_not_import_paramiko() -> None:
    code = "import sys, srprov.transport.openssh.way; sys.exit('paramiko' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=30)


@pytest.mark.parametrize("option", [("proxyjump", "gate"), ("proxycommand", "nc %h %p")])
def test_behind_something_nothing_is_dialled(option: tuple[str, str]) -> None:
    way = set_out(Host(name="r1", address="127.0.0.1", port=1, ssh_options=(option,)), ConnectOptions())
    assert way.socket is None and way.settings.port == 1
