"""A newer Docker for robots of the lab: that of Debian 13, laid over a robot's disk. Nothing of the machine changes.

Packages are found and downloaded by apt with folders of its own; the machine's own lists stay as they are. Containers
are run by the machine's runc, as that of Debian 13 needs its libc.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from srprov.lab.robot import enter
from tests.lab.conftest import Lab

SOURCE = "deb [signed-by=/usr/share/keyrings/debian-archive-keyring.gpg] http://deb.debian.org/debian trixie main\n"
PACKAGES = ("docker.io", "containerd", "docker-cli")
PROGRAMS = ("usr/sbin/dockerd", "usr/sbin/docker-proxy", "usr/bin/containerd", "usr/bin/containerd-shim-runc-v2")
LIMIT_S = 300
STARTED = """\
rm -rf /var/lib/docker/* /var/lib/containerd/* /run/lab/docker-stopped
n=300; until docker version >/dev/null 2>&1 || [ $n = 0 ]; do n=$((n-1)); sleep 0.1; done
docker info --format '{{json .}}'
"""


def programs(folder: Path) -> bytes:
    """Return a tar with the programs, which lie in it as on a robot."""
    for name in ("lists/partial", "cache/archives/partial", "root"):
        (folder / name).mkdir(parents=True)
    (folder / "status").touch()
    (folder / "sources.list").write_text(SOURCE, encoding="utf-8")
    options = {
        "Dir::Etc::sourcelist": folder / "sources.list", "Dir::Etc::sourceparts": "/dev/null",
        "Dir::State::lists": folder / "lists", "Dir::State::status": folder / "status", "Dir::Cache": folder / "cache",
    }  # fmt: skip
    apt = ["apt-get", "-q", "-o", "APT::Sandbox::User=root", *(f"-o{key}={value}" for key, value in options.items())]
    _run([*apt, "update"], folder)
    _run([*apt, "download", *PACKAGES], folder)
    for one in sorted(folder.glob("*.deb")):
        _run(["dpkg-deb", "-x", str(one), "root"], folder)
    return _run(["tar", "-C", "root", "-cf", "-", *PROGRAMS], folder)


def put(lab: Lab, robot: str, archive: bytes, *, containerd: bool) -> Mapping[str, Any]:
    """Give a robot the programs and an empty disk of Docker's; return what the engine says of itself."""
    lab.srprov("lab", "stop-docker", robot)
    unpack = enter(lab.site, robot, ("tar", "-C", "/", "-xf", "-"))
    subprocess.run(unpack, input=archive, check=True, timeout=LIMIT_S)
    path = "/etc/docker/daemon.json"
    config = json.loads(lab.shell(robot, "cat", path).out)
    if containerd:
        del config["storage-driver"]
        config["features"] = {"containerd-snapshotter": True}
    lab.shell(robot, "sh", "-c", f'printf %s "$0" >{path}', json.dumps(config))
    said = json.loads(lab.shell(robot, "sh", "-c", STARTED).out)
    assert isinstance(said, dict)
    return said


def _run(command: list[str], folder: Path) -> bytes:
    done = subprocess.run(command, cwd=folder, check=False, capture_output=True, timeout=LIMIT_S)
    assert done.returncode == 0, (command, done.stderr)
    return done.stdout
