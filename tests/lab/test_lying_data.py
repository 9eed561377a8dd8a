"""A robot that lies in an archive of a volume's data, which another robot unpacks as root."""

from __future__ import annotations

from pathlib import Path

import pytest

from srprov.transport.volume_copy import DEVICES
from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

OWN, NEW = "/var/lib/docker/volumes/own/_data", "/var/lib/docker/volumes/srprov.moved.d/_data"
LIAR = r"""
mv /usr/bin/tar /usr/bin/tar.own
mkdir -p /usr/lib/lie/as/b && cd /usr/lib/lie && printf 'rm -rf /\n' >as/x && ln -s "$1" as/p && : >as/b/file
for one in as/x as/b/file as/p as/b as; do touch -h -d @1700000000 $one; done
python3 - "$1" <<'END'
import sys, tarfile
with tarfile.open("lie.tar", "w") as tar:
    for name, kind, link, mode in (
        (".", b"5", "", 0o755), ("b", b"5", "", 0o755), ("p", b"2", "b", 0o777), ("p/file", b"2", "/nowhere", 0o777),
        ("x", b"1", "p/file", 0o644), ("p", b"2", sys.argv[1], 0o777), ("b/file", b"0", "", 0o644),
        ("b", b"5", "", 0o755),
    ):
        one = tarfile.TarInfo(name)
        one.type, one.linkname, one.mode, one.mtime = kind, link, mode, 1700000000
        tar.addfile(one)
END
cat >/usr/bin/tar <<'END'
#!/bin/bash
case "$*" in
*--sort=name*) cd /usr/lib/lie/as && exec /usr/bin/tar.own "$@" ;;
*--sparse*) exec cat /usr/lib/lie/lie.tar ;;
esac
exec /usr/bin/tar.own "$@"
END
chmod 755 /usr/bin/tar
"""
"""What it sends makes `x` a second name of the file `file` in a folder of the other robot; and its hash is right."""


def test_data_that_is_moved_makes_no_second_name_of_a_file_of_another_robot(lab_of_module: Lab, tmp_path: Path) -> None:
    """The mode, the time and the content of that file are known, as those of packages are; the move fails."""
    lab, path = lab_of_module, tmp_path / "moved.edf"
    inventory = part_of_lab(lab, ["robot1", "robot2"], tmp_path / "lab.yml")
    home = {"XDG_STATE_HOME": str(tmp_path / "state")}

    def apply(robot: str) -> Done:
        path.write_text(edf("moved", {"a": busybox(robot=robot, volumes=["d:/d"])}), encoding="utf-8")
        words = ("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--data", "move")
        return lab.srprov(*words, env=home)

    try:
        assert apply("robot1").code == 0
        make = f"docker volume create own && printf 'rm -rf /\\n' >{OWN}/file && touch -d @1700000000 {OWN}/file"
        lab.shell("robot2", "sh", "-ec", make)
        lab.shell("robot1", "sh", "-ec", LIAR, "sh", OWN)
        failed = apply("robot2")
        assert failed.code != 0 and "hard link" in failed.err, failed
        assert lab.shell("robot2", "stat", "-c", "%h", f"{OWN}/file").out == "1\n"
        assert lab.shell("robot2", "ls", NEW, check=False).code != 0
    finally:
        lab.shell("robot1", "sh", "-c", "mv /usr/bin/tar.own /usr/bin/tar; rm -rf /usr/lib/lie", check=False)
        lab.srprov("destroy", str(path), "-i", inventory, "--yes", "--volumes", env=home)
        lab.shell("robot2", "docker", "volume", "rm", "-f", "own", check=False)


class Moving:
    """An experiment of one service, whose data goes from robot to robot."""

    def __init__(self, lab: Lab, folder: Path, name: str) -> None:
        self.lab, self.name, self.path = lab, name, folder / f"{name}.edf"
        self.inventory = part_of_lab(lab, ["robot1", "robot2"], folder / "lab.yml")
        self.home = {"XDG_STATE_HOME": str(folder / "state")}

    def apply(self, service: dict[str, object], *words: str) -> Done:
        self.path.write_text(edf(self.name, {"a": service}), encoding="utf-8")
        given = ("apply", str(self.path), "-i", self.inventory, "--yes", "--settle", "0", "--data", "move", *words)
        return self.lab.srprov(*given, env=self.home)

    def destroy(self) -> None:
        self.lab.srprov("destroy", str(self.path), "-i", self.inventory, "--yes", "--volumes", env=self.home)


def test_data_that_is_moved_is_no_device_of_another_robot(lab_of_module: Lab, tmp_path: Path) -> None:
    """Its container may open devices of that robot: what it takes for its data was one, of the liar's choice."""
    lab, moving = lab_of_module, Moving(lab_of_module, tmp_path, "devices")
    data = "/var/lib/docker/volumes/srprov.devices.d/_data"

    def apply(robot: str) -> Done:
        one = busybox(robot=robot, volumes=["d:/d"], device_cgroup_rules=["c 10:229 rwm"])
        return moving.apply(one, "--allow", "device")

    try:
        assert apply("robot1").code == 0
        lab.shell("robot1", "mknod", f"{data}/map", "c", "10", "229")
        moved = apply("robot2")
        assert moved.code != 0 and DEVICES in moved.err, moved
        assert lab.shell("robot2", "ls", f"{data}/map", check=False).code != 0
        assert lab.shell("robot1", "ls", f"{data}/map").code == 0  # it is kept
        lab.shell("robot1", "rm", f"{data}/map")
        assert apply("robot2").code == 0
    finally:
        moving.destroy()


def test_data_that_is_moved_leads_no_other_mount_elsewhere(lab_of_module: Lab, tmp_path: Path) -> None:
    """A link in it had the service's second volume mounted over the programs of the container's image."""
    lab, moving = lab_of_module, Moving(lab_of_module, tmp_path, "nested")
    place = "/var/lib/docker/volumes/srprov.nested.d/_data/logs"

    def apply(robot: str) -> Done:
        return moving.apply(busybox(robot=robot, volumes=["d:/d", "logs:/d/logs"]))

    try:
        assert apply("robot1").code == 0
        lab.shell("robot1", "sh", "-ec", f"rmdir {place} && ln -s /bin {place}")
        done = apply("robot2")
        assert done.code != 0 and "logs in the volume srprov.nested.d is a link" in done.out + done.err
        assert lab.shell("robot2", "docker", "ps", "-aq", "--filter", "label=srprov.instance=nested").out == ""
        lab.shell("robot2", "sh", "-ec", f"rm {place} && mkdir {place}")
        assert apply("robot2").code == 0
        mounted = lab.shell("robot2", "docker", "exec", "srprov.nested.a", "grep", " /d[ /]", "/proc/mounts").out
        assert [line.split()[1] for line in mounted.splitlines()] == ["/d", "/d/logs"]
    finally:
        moving.destroy()


def test_who_still_writes_to_a_volume_leads_no_mount_below_it_elsewhere(lab_of_module: Lab, tmp_path: Path) -> None:
    """What `validate` refuses is not had on the way from one state of an EDF to the next one either."""
    lab, path = lab_of_module, tmp_path / "still.edf"
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    given = (str(path), "-i", inventory, "--yes")

    def apply(cam: str, *planner: str) -> Done:
        services = {
            "cam": busybox(robot="robot1", volumes=[cam], depends_on=["planner"]),
            "planner": busybox(robot="robot1", volumes=["data:/data", *planner]),
        }
        path.write_text(edf("still", services, placement={"slots_per_robot": 2}), encoding="utf-8")
        return lab.srprov("apply", *given, "--settle", "0")

    try:
        assert apply("data:/data").code == 0
        done = apply("data:/data", "logs:/data/logs")
        assert done.code == 5 and "'cam' may write to" in done.err
        done = apply("data:/data:ro", "logs:/data/logs")
        assert done.code != 0 and "srprov.still.cam may write to the volume srprov.still.data" in done.out + done.err
        lab.shell("robot1", "docker", "stop", "-t", "0", "srprov.still.cam")
        assert apply("data:/data:ro", "logs:/data/logs").code == 0
    finally:
        lab.srprov("destroy", *given, "--volumes")
