"""Robots that lie about others, or never stop to talk: it concerns them, and nobody else."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.lab.conftest import Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

LIAR = """\
real=$(command -v docker) && docker tag busybox:latest mine/busybox:1 && docker tag "$0" busybox:latest
printf '#!/bin/sh\\n[ "$1" != save ] || exec %s save %s busybox:latest\\nexec %s "$@"\\n' "$real" "$0" "$real" \
    > /usr/local/sbin/docker && chmod +x /usr/local/sbin/docker
"""
"""A robot whose archives carry one more tag than the image has that is asked for."""
PROXY = """\
import os, re, socket, threading
real, here = "/var/run/docker-real.sock", "/var/run/docker.sock"
os.rename(here, real)
server = socket.socket(socket.AF_UNIX)
server.bind(here)
server.listen(64)
def pump(source, target, lie):
    while data := source.recv(65536):
        target.sendall(re.sub(LIE, data) if lie else data)
    target.shutdown(socket.SHUT_WR)
while True:
    client, engine = server.accept()[0], socket.socket(socket.AF_UNIX)
    engine.connect(real)
    for ends in ((client, engine, False), (engine, client, True)):
        threading.Thread(target=pump, args=ends, daemon=True).start()
"""
"""Between a robot's engine and whoever asks it; LIE is what it says, and in place of what."""
OTHER = PROXY.replace("LIE", """b'"Architecture":"amd64"', b'"Architecture":"arm64"'""")
"""Its images are for another architecture than they are."""
NAMES = PROXY.replace(
    "LIE", r"""rb'"Id":"(sha256:\w{64})",("Labels":.[^}]*srprov.cdf[^}]*.,"ParentId":"sha256:\w{57})\w{7}"', """
    r"""rb'"Id":"\1 robot2",\2"'""")  # fmt: skip
"""The id of what was built there names another robot as well, as long as before."""
OWN_BASE = "printf 'FROM busybox\\nRUN echo robot1 >/not-yours\\n' | docker build -q -t busybox:latest -"
BETWEEN = """\
setsid python3 -c "$0" >/dev/null 2>&1 & echo $! >/tmp/proxy
while [ ! -S /var/run/docker-real.sock ] || ! docker version >/dev/null 2>&1; do sleep 0.1; done
"""
OTHER_KIND = f"""\
{OWN_BASE} &&
echo aarch64 >/tmp/arch && mount --bind /tmp/arch /proc/sys/kernel/arch
{BETWEEN}"""
HONEST_ENGINE = 'kill "$(cat /tmp/proxy)"; mv /var/run/docker-real.sock /var/run/docker.sock; rm /tmp/proxy'
SAME_KIND = f"{HONEST_ENGINE}; umount /proc/sys/kernel/arch; rm /tmp/arch"
HONEST = "rm /usr/local/sbin/docker; docker tag mine/busybox:1 busybox:latest; docker rmi mine/busybox:1"
CONTENT = ("docker", "exec", "srprov.kinds.one", "ls", "/not-yours")
RECORD = "/var/lib/srprov/lies/placement.json"


def test_a_robot_that_runs_nothing_redirects_no_traffic(lab_of_module: Lab, tmp_path: Path) -> None:
    """Its forged record, with the highest serial and itself as the end of another's tunnel, while that is away."""
    lab, path = lab_of_module, tmp_path / "lies.edf"
    services = {name: busybox(robot=robot, network="overlay") for name, robot in (("a", "robot1"), ("b", "robot2"))}
    path.write_text(edf("lies", services), encoding="utf-8")
    robots = ["robot1", "robot2", "robot3"]
    whole = part_of_lab(lab, robots, tmp_path / "whole.yml")
    gone = part_of_lab(lab, robots, tmp_path / "gone.yml", robot2={"ansible_port": 1})
    home = {"XDG_STATE_HOME": str(tmp_path / "state")}
    applied = lab.srprov("apply", str(path), "-i", whole, "--yes", "--settle", "0", env=home)
    assert applied.code == 0, applied
    tunnels = lab.shell("robot1", "bridge", "fdb", "show").out

    said = json.loads(lab.shell("robot1", "cat", RECORD).out)
    liar = said["robots"]["robot1"]["vtep"].rsplit(".", 1)[0] + ".66"
    said["robots"]["robot2"]["vtep"], said["serial"] = liar, 999_999
    lab.shell("robot3", "sh", "-c", f"mkdir -p /var/lib/srprov/lies; printf %s '{json.dumps(said)}' > {RECORD}")

    again = lab.srprov("apply", str(path), "-i", gone, "--yes", "--unreachable", "skip", "--settle", "0", env=home)
    assert again.code == 0 and "robot3 holds another record of this instance" in again.out + again.err, again
    assert lab.shell("robot1", "bridge", "fdb", "show").out == tunnels and liar not in tunnels

    lab.shell("robot3", "sh", "-c", f"mkdir -p /var/lib/srprov/lies; printf %s '{json.dumps(said)}' > {RECORD}")
    stranger = lab.srprov("plan", str(path), "-i", gone, env={"XDG_STATE_HOME": str(tmp_path / "none")})
    assert stranger.code == 9 and "robot1 and robot3 hold different records" in stranger.err, stranger
    assert lab.srprov("destroy", str(path), "-i", whole, "--yes", env=home).code == 0


def test_a_robot_that_never_stops_to_talk_is_out_of_reach_and_the_others_go_on(
    lab_of_module: Lab, tmp_path: Path
) -> None:
    lab = lab_of_module
    lab.shell("robot3", "sh", "-c", "echo 'cat /dev/zero' > /root/.bashrc")
    try:
        inventory = part_of_lab(lab, ["robot1", "robot3"], tmp_path / "lab.yml")
        began = time.monotonic()
        asked = lab.srprov("facts", "-i", inventory, "--json")
        assert asked.code == 4 and set(asked.json["robots"]) == {"robot1"}, asked
        assert "printed more than 1 MiB before the shell was ready" in asked.json["unreachable"]["robot3"]
        assert time.monotonic() - began < 60
    finally:
        lab.shell("robot3", "rm", "-f", "/root/.bashrc")


def test_logs_of_many_lines_and_of_a_very_long_one_come_whole(lab_of_module: Lab, tmp_path: Path) -> None:
    lab, path = lab_of_module, tmp_path / "chatty.edf"
    noise = "head -c 1200000 /dev/zero | tr '\\0' x; echo; seq 1 5000; sleep 86400"
    path.write_text(edf("chatty", {"loud": busybox("sh", "-c", noise, robot="robot1")}), encoding="utf-8")
    inventory = part_of_lab(lab, ["robot1"], tmp_path / "lab.yml")
    assert lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "1").code == 0
    shown = lab.srprov("logs", str(path), "-i", inventory, "-n", "3000000")
    lines = shown.out.splitlines()
    assert shown.code == 0 and not shown.err and lines[-1] == "loud | 5000", shown.err
    assert len(lines) < 5_010 and sum(line.count("x") for line in lines) == 1_200_000


def test_an_image_is_copied_only_from_where_it_was_built_and_without_what_lies_beside_it(
    lab_of_module: Lab, tmp_path: Path
) -> None:
    """A tag that a robot lists is its own word; and the archive that it gives is written anew."""
    lab, path, home = lab_of_module, tmp_path / "lies.edf", {"XDG_STATE_HOME": str(tmp_path / "state")}
    (tmp_path / "x.cdf").write_text("cdf: 1\nname: lies\nbase: busybox\ncommand: [sleep, '86400']\n", encoding="utf-8")
    inventory = part_of_lab(lab, ["robot1", "robot2", "robot3"], tmp_path / "lab.yml")

    def on(robot: str) -> str:
        service = {"cdf": "x.cdf", "robot": robot, "stop_signal": "SIGKILL"}
        path.write_text(edf("lies", {"one": service}), encoding="utf-8")
        return str(path)

    def how() -> list[tuple[str, str]]:
        steps = lab.srprov("plan", on("robot2"), "-i", inventory, "--json", env=home).json["steps"]
        return sorted((one["robot"], one["cause"]) for one in steps if one["module"] == "image")

    applied = lab.srprov("apply", on("robot1"), "-i", inventory, "--yes", "--settle", "0", "--json", env=home)
    assert applied.code == 0, applied
    tag = next(one["id"].partition("image:")[2] for one in applied.json["steps"] if "/image:" in one["id"])
    ((target, cause),) = how()
    # its one layer is the base's, which a test before may have left there
    assert target == "robot2" and re.match("not on the robot; copied from robot1, [01] of 1 layers", cause), cause
    lab.shell("robot1", "docker", "tag", tag, "srprov/kept:1")
    theirs = lab.shell("robot2", "docker", "images", "-q", "busybox:latest").out
    lab.shell("robot1", "sh", "-c", LIAR, tag)
    try:
        saved = lab.shell("robot1", "sh", "-c", "docker save x | tar -xO manifest.json").out
        assert "busybox:latest" in saved and tag in saved, saved
        moved = lab.srprov("apply", on("robot2"), "-i", inventory, "--yes", "--settle", "0", "--reassign", env=home)
    finally:
        lab.shell("robot1", "sh", "-c", HONEST)
    assert moved.code == 0, moved
    ids = [lab.shell(robot, "docker", "image", "inspect", "-f", "{{.Id}}", tag).out for robot in ("robot1", "robot2")]
    assert ids[0] == ids[1] and "srprov/kept" not in lab.shell("robot2", "docker", "images").out
    assert lab.shell("robot2", "docker", "images", "-q", "busybox:latest").out == theirs

    lab.shell("robot2", "docker", "rm", "-f", "srprov.lies.one")
    lab.shell("robot2", "docker", "rmi", tag)
    lab.shell("robot1", "docker", "tag", "busybox", tag)
    ((robot, cause),) = how()
    assert robot == "robot2" and cause.startswith("not on the robot; built here"), cause
    assert lab.srprov("destroy", str(path), "-i", inventory, "--yes", env=home).code == 0


class OwnBase:
    """robot1 builds on a base of its own making; then the service moves to robot2, the builder of the inventory."""

    def __init__(self, lab: Lab, folder: Path) -> None:
        self.lab, self.path, self.home = lab, folder / "kinds.edf", {"XDG_STATE_HOME": str(folder / "state")}
        cdf = "cdf: 1\nname: kinds\nbase: busybox\ncommand: [sleep, '86400']\n"
        (folder / "x.cdf").write_text(cdf, encoding="utf-8")
        self.alone = part_of_lab(lab, ["robot1"], folder / "alone.yml")
        self.both = part_of_lab(lab, ["robot1", "robot2"], folder / "lab.yml")
        self.builders = str(folder / "builders.yml")
        Path(self.builders).write_text("builders: {hosts: {robot2: {}}}\n", encoding="utf-8")

    def on(self, robot: str, *words: str) -> Done:
        service = {"cdf": "x.cdf", "robot": robot, "stop_signal": "SIGKILL"}
        self.path.write_text(edf("kinds", {"one": service}), encoding="utf-8")
        more = ("--yes", "--settle", "0", "--no-probe", *words)
        return self.lab.srprov("apply", str(self.path), *more, env=self.home)

    def check(self, applied: Done) -> None:
        """Look at both robots, once robot1 has built."""
        assert applied.code == 0 and self.lab.shell("robot1", *CONTENT).out
        self.check_other("robot2", self.both)

    def check_other(self, robot: str, inventory: str, *words: str) -> None:
        """Look at another robot, to which the service moves."""
        moved = self.on(robot, "-i", inventory, "-i", self.builders, "--reassign", *words)
        assert moved.code == 0 and "copied from" not in moved.out, moved
        assert self.lab.shell(robot, *CONTENT, check=False).code != 0
        assert self.lab.srprov("destroy", str(self.path), "-i", inventory, "--yes", env=self.home).code in (0, 4)


@pytest.fixture
def own_base(lab_of_module: Lab, tmp_path: Path) -> Iterator[OwnBase]:
    """Give what builds; afterwards robot1 has its registry's base again, and neither robot an image of the test."""
    pulled = "docker pull -q busybox >/dev/null && docker images -q busybox:latest"
    real = lab_of_module.shell("robot1", "sh", "-c", pulled).out.strip()
    yield OwnBase(lab_of_module, tmp_path)
    lab_of_module.shell("robot1", "docker", "tag", real, "busybox:latest")
    gone = 'i=$(docker images -q srprov/kinds); [ -z "$i" ] || docker rmi -f $i; docker image prune -f'
    for robot in ("robot1", "robot2", "robot3"):
        lab_of_module.shell(robot, "sh", "-c", gone)


def test_a_robot_that_was_of_another_architecture_builds_for_no_builder(lab_of_module: Lab, own_base: OwnBase) -> None:
    """It said so while it built an image for itself, on a base of its own making; the inventory has another builder."""
    lab_of_module.shell("robot1", "sh", "-c", OTHER_KIND, OTHER)
    try:
        applied = own_base.on("robot1", "-i", own_base.both, "-i", own_base.builders)
    finally:
        lab_of_module.shell("robot1", "sh", "-c", SAME_KIND)
    own_base.check(applied)


def test_a_robot_that_built_for_itself_alone_builds_for_no_builder(lab_of_module: Lab, own_base: OwnBase) -> None:
    """Its own inventory named no builder, and its base was of its own making; the laboratory's names another robot."""
    lab_of_module.shell("robot1", "sh", "-c", OWN_BASE)
    own_base.check(own_base.on("robot1", "-i", own_base.alone))


def test_where_the_only_builder_is_away_no_other_robot_builds_for_others(
    lab_of_module: Lab, own_base: OwnBase, tmp_path: Path
) -> None:
    """The first robot by name has a base of its own making; the one that the inventory names cannot be reached."""
    lab_of_module.shell("robot1", "sh", "-c", OWN_BASE)
    gone = part_of_lab(lab_of_module, ["robot1", "robot2", "robot3"], tmp_path / "gone.yml", robot2={"ansible_port": 1})
    own_base.check_other("robot3", gone, "--unreachable", "skip")


def test_a_robot_that_names_another_one_as_builder_builds_for_nobody(
    lab_of_module: Lab, own_base: OwnBase, tmp_path: Path
) -> None:
    """It built alone, and the id that its engine said names a builder of the laboratory, which is away now."""
    lab_of_module.shell("robot1", "sh", "-c", f"{OWN_BASE} && {BETWEEN}", NAMES)
    try:
        own_base.on("robot1", "-i", own_base.alone)
    finally:
        lab_of_module.shell("robot1", "sh", "-c", HONEST_ENGINE)
    gone = part_of_lab(lab_of_module, ["robot1", "robot2", "robot3"], tmp_path / "gone.yml", robot2={"ansible_port": 1})
    Path(own_base.builders).write_text("builders: {hosts: {robot2: {}, robot3: {}}}\n", encoding="utf-8")
    own_base.check_other("robot3", gone, "--unreachable", "skip")


def test_a_robot_that_has_a_builder_s_name_in_another_inventory_builds_for_nobody(
    lab_of_module: Lab, own_base: OwnBase, tmp_path: Path
) -> None:
    """It built alone, as robot2 of that inventory; here robot2 is another one, a builder, which is away now."""
    lab = lab_of_module
    lab.shell("robot1", "sh", "-c", OWN_BASE)
    address = re.search(r"ansible_host: (\S+)", Path(own_base.alone).read_text(encoding="utf-8"))
    assert address
    alone = part_of_lab(lab, ["robot2"], tmp_path / "namesake.yml", robot2={"ansible_host": address[1]})
    assert own_base.on("robot2", "-i", alone).code == 0 and lab.shell("robot1", *CONTENT).out
    assert lab.srprov("destroy", str(own_base.path), "-i", alone, "--yes", env=own_base.home).code == 0
    gone = part_of_lab(lab, ["robot1", "robot2", "robot3"], tmp_path / "gone.yml", robot2={"ansible_port": 1})
    Path(own_base.builders).write_text("builders: {hosts: {robot2: {}, robot3: {}}}\n", encoding="utf-8")
    own_base.check_other("robot3", gone, "--unreachable", "skip")
