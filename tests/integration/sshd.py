"""A real OpenSSH server on loopback, with its own keys, configuration and home, for tests of the transport."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from srprov.definitions.model import Host

SSHD = shutil.which("sshd", path="/usr/sbin:/usr/local/sbin:/sbin:/usr/bin")


def usable() -> bool:
    return SSHD is not None and os.geteuid() == 0 and shutil.which("ssh-keygen") is not None


def free_port() -> int:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        port: int = sock.getsockname()[1]
        return port


def keygen(path: Path, kind: str = "ed25519", passphrase: str = "") -> Path:
    subprocess.run(["ssh-keygen", "-q", "-t", kind, "-N", passphrase, "-C", path.name, "-f", str(path)], check=True)
    return path


def public(path: Path) -> str:
    return " ".join(path.with_suffix(".pub").read_text().split()[:2])


@dataclass
class Sshd:
    """One server. `login` is a shell script put in front of each command, to play a user's `.bashrc`."""

    folder: Path
    options: dict[str, str] = field(default_factory=dict)
    login: str = ""
    port: int = field(default_factory=free_port)
    process: subprocess.Popen[bytes] | None = None

    def __post_init__(self) -> None:
        self.folder.mkdir(parents=True, exist_ok=True)
        self.host_key = keygen(self.folder / "host_ed25519")
        self.user_key = keygen(self.folder / "user_ed25519")
        self.known_hosts = self.folder / "known_hosts"
        (self.folder / "authorized_keys").write_text(public(self.user_key) + "\n")
        self.trust()

    def trust(self, key: Path | None = None) -> None:
        self.known_hosts.write_text(f"# test\n[127.0.0.1]:{self.port} {public(key or self.host_key)}\n")

    def start(self) -> Sshd:
        options = {
            "Port": str(self.port),
            "ListenAddress": "127.0.0.1",
            "HostKey": str(self.host_key),
            "AuthorizedKeysFile": str(self.folder / "authorized_keys"),
            "PidFile": "none",
            "StrictModes": "no",
            "UsePAM": "no",
            "PasswordAuthentication": "no",
            "PermitRootLogin": "yes",
            **self.options,
        }
        if self.login:
            script = self.folder / "login.sh"
            script.write_text(f'{self.login}\nexec sh -c "$SSH_ORIGINAL_COMMAND"\n')
            options["ForceCommand"] = f"/bin/sh {script}"
        config = self.folder / "sshd_config"
        config.write_text("".join(f"{key} {value}\n" for key, value in options.items()))
        Path("/run/sshd").mkdir(exist_ok=True)
        assert SSHD
        self.process = subprocess.Popen(
            [SSHD, "-D", "-f", str(config), "-E", str(self.folder / "log")], start_new_session=True
        )
        for _ in range(500):
            with socket.socket() as sock:
                if sock.connect_ex(("127.0.0.1", self.port)) == 0:
                    return self
            time.sleep(0.01)
        raise AssertionError(f"sshd did not start: {(self.folder / 'log').read_text()}")

    def connections(self) -> list[int]:
        """Return the processes that serve connections, oldest first."""
        assert self.process
        done = subprocess.run(["pgrep", "-P", str(self.process.pid)], capture_output=True, text=True, check=False)
        return [int(pid) for pid in done.stdout.split()]

    def cut(self) -> None:
        """Kill what serves connections, as when a robot reboots."""
        for pid in self.connections():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)

    def stop(self) -> None:
        if self.process and self.process.poll() is None:
            self.cut()
            self.process.terminate()
            self.process.wait(10)

    def host(self, name: str = "r1", **more: Any) -> Host:
        values: dict[str, Any] = {
            "name": name,
            "address": "127.0.0.1",
            "port": self.port,
            "user": "root",
            "identity_file": str(self.user_key),
            "ssh_options": (("userknownhostsfile", str(self.known_hosts)), ("identityagent", "none")),
        }
        return Host(**{**values, **more})
