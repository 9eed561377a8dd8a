"""What a path of a robot is beside what its name says, as the plan tells it."""

from __future__ import annotations

import os
import socket
import subprocess
from pathlib import Path

import pytest

from srprov.controller.other_names import USED, other_names, places_of_root, used
from srprov.controller.robot_mounts import Mounts
from srprov.definitions.containermodel import Mount
from srprov.robot_answers import TooManyError
from tests.bounded import bounded
from tests.fakes import World
from tests.worlds import experiment, plan_for, service

ROOT = "20 1 8:1 / / rw - ext4 /dev/sda1 rw\n"
DATA = ROOT + "21 20 8:2 / /data rw - ext4 /dev/sda2 rw\n"
ETC = "22 20 0:40 / /etc rw - overlay overlay rw,lowerdir=/etc,upperdir=/data/overlay-etc/upper,workdir=/data/w\n"
LIVE = (
    "20 1 0:30 / / rw - overlay overlayroot rw,lowerdir=/media/root-ro,upperdir=/media/root-rw/overlay\n"
    "21 20 8:1 / /media/root-ro ro - ext4 /dev/sda1 ro\n22 20 0:31 / /media/root-rw rw - tmpfs tmpfs rw\n"
)
HOMES = DATA + "23 20 8:2 /people /home rw - ext4 /dev/sda2 rw\n"
WRITTEN = "root may run or believe what is written there"


def said(mounts: str, path: str, *others: str, read_only: bool = False) -> list[str]:
    return list(other_names([(path, path, read_only)], Mounts(mounts), others))


@pytest.mark.parametrize(
    ("mounts", "path", "names"),
    [
        (DATA + ETC, "/data", "/etc"),
        (DATA + ETC, "/data/overlay-etc", "/etc"),
        (DATA + ETC, "/data/overlay-etc/upper/cron.d", "/etc/cron.d"),
        (LIVE, "/media/root-rw/overlay/etc", "/etc"),
        (LIVE, "/media/root-ro/opt/x", "/opt/x"),
        (HOMES, "/data", "/home"),
        (HOMES, "/data/people/lab/maps", "/home/lab/maps"),
        (ROOT + "24 20 8:1 / /mnt/all rw - ext4 /dev/sda1 rw\n", "/mnt/all/usr", "/usr"),
        (DATA + "25 21 8:1 /var/spool /data/x rw - ext4 /dev/sda1 rw\n", "/data", "/var/spool"),
    ],
)
def test_another_name_of_a_path_counts(mounts: str, path: str, names: str) -> None:
    """An image of Yocto's has the upper layer of `/etc` below `/data`: who has `/data` writes rules for root."""
    assert said(mounts, path) == [f"{path} is, holds or lies in {names}: {WRITTEN}"]


@pytest.mark.parametrize(
    ("mounts", "path"),
    [
        (ROOT, "/data/maps"),
        (DATA, "/data/maps"),
        (DATA + ETC, "/data/maps"),
        (DATA + ETC, "/srv/maps"),
        (HOMES, "/data/maps"),
        (DATA + "26 20 8:2 /maps /srv/maps rw - ext4 /dev/sda2 rw\n", "/data"),
        (DATA + ETC, "/etc"),
        (LIVE.replace("/media/root-rw", "/run/live"), "/srv/maps"),
        ("", "/data"),
        ("garbage\n", "/data"),
    ],
)
def test_where_data_are_by_each_name_or_it_was_said_nothing_is(mounts: str, path: str) -> None:
    assert said(mounts, path) == []


def test_what_a_robot_uses_counts_whatever_its_name() -> None:
    """Somebody's home, the file that memory is swapped to, and one that a file system is in."""
    others = used("/srv/robot\n/mnt/swapfile\n/\nrelative\n/data/usr.img\n/home/lab\n")
    assert others == ["/data/usr.img", "/home/lab", "/mnt/swapfile", "/srv/robot"]
    assert said(DATA, "/srv", *others) == [f"/srv is, holds or lies in /srv/robot: {WRITTEN}"]
    assert said(DATA, "/srv/robot/bin", *others) == [f"/srv/robot/bin is, holds or lies in /srv/robot: {WRITTEN}"]
    assert "/mnt/swapfile: a key there" in said(DATA, "/mnt", *others, read_only=True)[0]
    assert said(DATA, "/data/usr.img", *others) and not said(DATA, "/srv/robots", *others)


def found_in(folder: Path, files: dict[str, str], *shell: str) -> list[str]:
    """Return what a shell finds in a robot with these files."""
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)
    asked = [*shell, "-c", places_of_root(str(folder))]
    return used(subprocess.run(asked, capture_output=True, text=True, check=True).stdout)


@pytest.mark.parametrize("shell", [("dash",), ("bash",), ("busybox", "sh")])
def test_a_shell_says_where_root_s_programs_look_for_data(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """Salt's own folders, links to data, and programs there that units, rules of udev and the like start."""
    for name, to in {"etc/app": "../data/app", "etc/b/c": "/mnt/it is", "etc/d": "data/no", "opt": "/data/opt"}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).symlink_to(to)
    files = {
        "srv/salt/top.sls": "",
        "etc/systemd/system/a.service": "[Service]\nExecStart=-/data/svc/run --x=/mnt/a-b\nDescription=/data/no\n",
        "etc/systemd/system/b.mount": "[Mount]\nWhere=/data\nWhat=/mnt/no\n",
        "etc/cron.d/x": "# /srv/no\n* * * * * root /opt/data/no; /srv/job\n",
        "etc/udev/rules.d/9.rules": 'RUN+="/media/hook"\n',
    }
    named = ("/data/app", "/data/opt", "/data/svc/run", "/media/hook", "/mnt/a-b", "/mnt/it is", "/srv/job")
    assert found_in(tmp_path, files, *shell) == [*named, f"{tmp_path}/srv/salt"]


@pytest.mark.parametrize("shell", [("dash",), ("bash",), ("busybox", "sh")])
def test_whatever_settings_and_start_files_name_counts(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """Where a unit works, its further lines and variables; what begins a shell, a session by SSH, or a path."""
    files = {
        "etc/passwd": "root:x:0:0::/root:/bin/bash\nann:x:1:1::/home/ann:/bin/sh\nd:x:2:2::/srv/no:/sbin/nologin\n",
        "etc/fstab": "/dev/sda1 /mnt/no ext4 defaults 0 0\n",
        "etc/systemd/system/nav.service": "[Service]\nWorkingDirectory=/data\nExecStart=docker compose up\n",
        "etc/systemd/system/app.service": "[Service]\nExecStart=/usr/bin/python3 \\\n  /srv/app/main.py\n",
        "usr/local/lib/systemd/system/c.service": "[Service]\nEnvironment=PYTHONPATH=/srv/lib\n",
        "usr/local/bin/go": "#!/bin/sh\ncd /srv/go && ./go\n",
        "etc/environment": 'PATH="/usr/bin:/srv/path"\n',
        "etc/ssh/sshd_config": "  AuthorizedKeysFile /srv/keys/%u\n",
        "root/.bashrc": "  # /srv/no\nsource /srv/ws/install/setup.bash\n",
        "root/.bash_history": "ls /srv/no\n",
        "home/ann/.profile": ". /mnt/ws/setup.sh\n",
        "home/ann/.config/systemd/user/u.service": "[Service]\nExecStart=/media/ann/run\n",
        "home/ann/notes": "/srv/no\n",
    }
    named = ["/data", "/media/ann/run", "/mnt/ws/setup.sh", "/srv/app/main.py", "/srv/go", "/srv/keys", "/srv/lib"]
    assert found_in(tmp_path, files, *shell) == [*named, "/srv/path", "/srv/ws/install/setup.bash"]


@pytest.mark.parametrize("shell", [("dash",), ("bash",), ("busybox", "sh")])
def test_a_shell_says_where_sockets_are(tmp_path: Path, shell: tuple[str, ...]) -> None:
    """Who is behind one answers whoever has its folder, also read-only."""
    (tmp_path / "data").mkdir()
    (tmp_path / "link").symlink_to("data")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "link" / "ask me.sock"))
        listening.listen()
        found = used(subprocess.run([*shell, "-c", USED.command], capture_output=True, text=True, check=True).stdout)
    real = f"{os.path.realpath(tmp_path)}/data/ask me.sock"
    assert real in found
    (line,) = said("", f"/srv/{tmp_path.name}", f"/srv/{tmp_path.name}/ask me.sock", read_only=True)
    assert "a socket there may do as root what it is told" in line


def test_a_plan_says_so_of_each_robot_of_a_new_container() -> None:
    world = World().add("r1")
    world.robots["r1"].mounts, world.robots["r1"].used = DATA + ETC, "/data/people/lab\n"
    mounts = (Mount(kind="bind", source="/data", target="/x"),)
    notes = plan_for(world, experiment(service("a", mounts=mounts))).notes
    assert notes == (f"r1: /data, which 'a' mounts, is, holds or lies in /etc, /data/people/lab: {WRITTEN}",)


def test_what_has_no_end_is_told_in_time() -> None:
    mounts = ROOT + "".join(f"{30 + n} 20 8:{n} /x{n} /m{n}/{n} rw - ext4 x rw\n" for n in range(50_000))
    paths = [(f"/srv/{n}", f"/srv/{n}", False) for n in range(3000)]
    assert bounded(lambda: list(other_names(paths, Mounts(mounts), ())), 10.0) == []
    endless = ROOT + "".join(f"{30 + n} 20 8:1 /srv/m /m{n} rw - ext4 x rw\n" for n in range(90_000))
    (line,) = bounded(lambda: said(endless + "9 20 8:1 / /mnt/z rw - ext4 x rw\n", "/srv/m"), 20.0)
    assert line.endswith(f" and more: {WRITTEN}")


def test_places_that_are_too_many_are_not_left_out_in_silence(tmp_path: Path) -> None:
    """A robot whose settings name a thousand others before this one: the plan said nothing of it."""
    (tmp_path / "etc").mkdir()
    (tmp_path / "etc" / "long").write_text("".join(f"run /data/a{n}\n" for n in range(1000)) + "run /data/zz\n")
    done = subprocess.run(["sh", "-c", places_of_root(str(tmp_path))], capture_output=True, text=True, check=True)
    known = used(done.stdout)
    assert "/data/zz" not in known
    assert said(ROOT, "/data/zz", *known) == [
        "root's programs name more places of data than are looked at: whether these are among them is not known"
    ]
    (tmp_path / "etc" / "long").write_text("run /data/zz\n")
    done = subprocess.run(["sh", "-c", places_of_root(str(tmp_path))], capture_output=True, text=True, check=True)
    assert said(ROOT, "/data/zz", *used(done.stdout)) == [f"/data/zz is, holds or lies in /data/zz: {WRITTEN}"]
    assert "?" in used("/a\n" * 10_001) and "?" not in used("/a\n" * 9_999)


def test_mounts_that_are_not_read_are_not_left_out_in_silence() -> None:
    many = "\n".join(f"{n} 1 0:{n} / /m/{n} rw - tmpfs t rw" for n in range(2, 100_002))
    last = "\n200000 1 8:1 /etc /srv/x rw - ext4 /dev/sda1 rw"
    (line,) = said(many + last, "/srv/x")
    assert line.endswith("more is mounted there than can be looked through: what else it is is not known")
    with pytest.raises(TooManyError):
        Mounts(many + last).writable_below("/srv")


@pytest.mark.parametrize(
    "lines",
    [
        f"21 20 8:2 / {'/a' * 200_000} rw - ext4 /dev/sda2 rw\n",
        f"21 20 8:2 {'/a' * 200_000} /data rw - ext4 /dev/sda2 rw\n",
        "".join(f"{number} 20 8:1 / /m/{number} rw - ext4 /dev/sda1 rw\n" for number in range(21, 75_000)),
    ],
    ids=["a long place", "a long root", "one file system at many places"],
)
def test_long_names_of_mounts_are_told_in_time(lines: str) -> None:
    """A robot of which a service mounts a path held up the plans of all, and took gigabytes."""
    path = "/srv" + "/aaaa" * 800
    (line,) = bounded(lambda: said(ROOT + lines, path, read_only=True), cpu_s=4)
    assert line.endswith("more is mounted there than can be looked through: what else it is is not known")
