"""A robot that somebody set up by hand: a package of apt, one of pip from git, a repository with changes, containers.

Everything is done through the robot's namespaces, as a person at its keyboard would do it.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

from srprov.lab import state
from tests.lab.conftest import Lab

PASSWORD = "hunter2-of-the-lab"
TOKEN = "ghp_0123456789abcdefghijABCDEFGHIJ012345"
PACKAGE = "srprov-by-hand"
WORKSPACE = "/home/robot/ws/src/driver"
BACKEND = """\
import base64, hashlib, zipfile
def build_wheel(folder, config_settings=None, metadata_directory=None):
    files = {"by_hand.py": "VERSION = 1\\n",
             "by_hand-1.5.dist-info/METADATA": "Metadata-Version: 2.1\\nName: by-hand\\nVersion: 1.5\\n",
             "by_hand-1.5.dist-info/WHEEL": "Wheel-Version: 1.0\\nGenerator: x\\nRoot-Is-Purelib: true\\n"
                                            "Tag: py3-none-any\\n"}
    files["by_hand-1.5.dist-info/RECORD"] = "".join(f"{name},,\\n" for name in files)
    with zipfile.ZipFile(f"{folder}/by_hand-1.5-py3-none-any.whl", "w") as wheel:
        for name, text in files.items():
            wheel.writestr(name, text)
    return "by_hand-1.5-py3-none-any.whl"
"""
PROJECT = '[build-system]\nrequires = []\nbuild-backend = "backend"\nbackend-path = ["."]\n'
CONTAINERS = f"""\
docker pull -q busybox >/dev/null
docker network create field >/dev/null
docker run -d --name Camera.Front --network host -e ROS_DOMAIN_ID=7 -e DB_PASSWORD='{PASSWORD}' \\
  --restart unless-stopped --device /dev/net/tun:/dev/lidar --cap-add SYS_NICE --ulimit nofile=1024:2048 \\
  -v maps:/maps -v /opt/data:/data:ro \\
  busybox sh -c 'exec sleep 86400' >/dev/null
docker run -d --name db --network field -p 127.0.0.1:5432:80 -m 64m --cpus 0.5 --tmpfs /tmp:size=8m -e 'TWO=a
b' -e TOKEN={TOKEN} --health-cmd 'wget -q --header "Authorization: Bearer {TOKEN}" http://localhost' \\
  --health-interval 7s --label team=drive --stop-timeout 3 busybox \\
  sh -c 'echo changed >/etc/changed; exec sleep 86400' --password '{PASSWORD}' >/dev/null
docker create --name stopped busybox true >/dev/null
"""


def root_of(lab: Lab, robot: str) -> Path:
    """Return the root of a robot's file system as this machine sees it."""
    booted = state.read_robot(lab.site, robot)
    assert booted is not None
    return Path(f"/proc/{booted.init.pid}/root")


def git(folder: Path, *words: str) -> str:
    """Run git here."""
    run = ["git", "-c", "user.name=a", "-c", "user.email=a@b.c", *words]
    return subprocess.run(run, cwd=folder, capture_output=True, check=True, text=True).stdout.strip()


def code(folder: Path) -> str:
    """Make a repository that is a package of Python's; return its commit."""
    folder.mkdir(parents=True)
    git(folder, "init", "-q", "-b", "main")
    (folder / "backend.py").write_text(BACKEND, encoding="utf-8")
    (folder / "pyproject.toml").write_text(PROJECT, encoding="utf-8")
    (folder / "speed.yaml").write_text("speed: 1\n", encoding="utf-8")
    (folder / "login.yaml").write_text("user: robot\n", encoding="utf-8")
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", "1")
    return git(folder, "rev-parse", "HEAD")


def package(folder: Path) -> Path:
    """Make a Debian package that no archive has."""
    tree = folder / "deb"
    (tree / "DEBIAN").mkdir(parents=True)
    (tree / "usr/share").mkdir(parents=True)
    (tree / "usr/share/by-hand").write_text("x\n", encoding="utf-8")
    about = f"Package: {PACKAGE}\nVersion: 2.5-1\nArchitecture: all\nMaintainer: a <a@b.c>\nDescription: x\n"
    (tree / "DEBIAN/control").write_text(about, encoding="utf-8")
    made = folder / "by-hand.deb"
    subprocess.run(["dpkg-deb", "--root-owner-group", "-b", str(tree), str(made)], check=True, capture_output=True)
    return made


def set_up(lab: Lab, robot: str, repository: Path, packages: Path) -> str:
    """Set a robot up; return the commit of the repository, which is at the same path here and there."""
    commit = code(repository)
    root = root_of(lab, robot)
    there = root / str(repository).lstrip("/")
    there.parent.mkdir(parents=True, exist_ok=True)
    subprocess.run(["cp", "-a", str(repository), str(there)], check=True)
    shutil.copy(package(packages), root / "root/by-hand.deb")
    for folder in (*there.parents,):
        if folder in (root, root / "tmp"):
            break
        os.chmod(folder, 0o755)
    script = f"""set -e
dpkg -i /root/by-hand.deb >/dev/null
PIP_BREAK_SYSTEM_PACKAGES=1 python3 -m pip install -q --no-deps --root-user-action ignore 'git+file://{repository}' 2>&1
mkdir -p /home/robot/ws/src /home/robot/ws/install /opt/data
touch /home/robot/ws/install/setup.bash
git clone -q file://{repository} {WORKSPACE}
cd {WORKSPACE}
echo 'speed: 2' >speed.yaml
echo 'password: {PASSWORD}' >>login.yaml
echo x >not-tracked
git remote set-url origin 'file://{repository}'
chown -R robot: /home/robot/ws
{CONTAINERS}"""
    done = lab.shell(robot, "sh", "-c", script, check=False)
    assert done.code == 0, done
    return commit


def take_down(lab: Lab, robot: str) -> None:
    """Give the robot back as it was, but for containers, which the fixtures remove."""
    script = f"""dpkg -P {PACKAGE} >/dev/null 2>&1; python3 -m pip uninstall -q -y --break-system-packages by-hand
rm -rf /home/robot/ws /home/robot/traps /root/traps /root/by-hand.deb /opt/data"""
    lab.shell(robot, "sh", "-c", script, check=False)
