"""Robots of two architectures: robot2 of this lab says that it is an arm64, and runs what arm64 runs.

It is a lab of its own, which a test or two can wait for; `make soak` has the others.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.lab import arm64
from tests.lab.conftest import NAME, Done, Lab

pytestmark = pytest.mark.lab

ROBOTS = {"robot1": "x86_64", "robot2": "aarch64", "robot3": "x86_64"}
IMAGES = {"x86_64": "amd64", "aarch64": "arm64"}
CDF = "cdf: 1\nname: machine\nbase: busybox\nrun: [uname -m > /arch]\ncommand: [sleep, '86400']\nstop_signal: SIGKILL\n"


class Mixed(Lab):
    """The lab, with an experiment of one service on each robot."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, f"{NAME}-arch")
        self.env = {f"XDG_{kind}_HOME": str(folder / kind) for kind in ("STATE", "CACHE")}
        (folder / "machine.cdf").write_text(CDF, encoding="utf-8")
        services = {f"on-{robot}": {"cdf": "machine.cdf", "robot": robot} for robot in ROBOTS}
        self.edf = self.experiment("both", services)

    def experiment(self, name: str, services: dict[str, dict[str, Any]]) -> str:
        path = self.folder / f"{name}.edf"
        path.write_text(json.dumps({"edf": 1, "name": name, "services": services}), encoding="utf-8")
        return str(path)

    def run(self, verb: str, file: str, *more: str) -> Done:
        return self.srprov(verb, file, "-i", str(self.inventory), *more, env=self.env)

    def apply(self, file: str, code: int = 0) -> Any:
        applied = self.run("apply", file, "--yes", "--json", "--settle", "0")
        assert applied.code == code, applied
        return applied.json

    def image(self, robot: str, name: str) -> dict[str, Any]:
        """Give what a robot's engine says of an image."""
        (found,) = json.loads(self.shell(robot, "docker", "image", "inspect", name).out)
        assert isinstance(found, dict)
        return found


@pytest.fixture(scope="module")
def mixed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Mixed]:
    lab = Mixed(tmp_path_factory.mktemp("architectures"))
    (lab.folder / "lab-spec.yml").write_text("count: 3\nrobots: {robot2: {arch: arm64}}\n", encoding="utf-8")
    try:
        up = lab.srprov("lab", "up", "--spec", "lab-spec.yml")
        assert up.code == 0, up
        yield lab
    finally:
        lab.srprov("lab", "down")


@pytest.mark.soak
def test_a_robot_of_another_architecture_says_so_everywhere(mixed: Mixed) -> None:
    for robot, machine in ROBOTS.items():
        said = mixed.shell(robot, "sh", "-c", "uname -m; arch; docker info --format '{{.Architecture}}'").out.split()
        assert said == [machine] * 3
        assert mixed.shell(robot, "docker", "version", "--format", "{{.Server.Arch}}").out.strip() == IMAGES[machine]
    facts = mixed.srprov("facts", "-i", str(mixed.inventory), "--json", env=mixed.env).json
    assert {name: one["arch"] for name, one in facts["robots"].items()} == {r: IMAGES[m] for r, m in ROBOTS.items()}
    steps = (
        (("kill", "--docker"), ("restart", "--docker")),
        (("stop-docker",), ("restart", "--docker")),
        (("restart",),),
    )
    for words in steps:  # the proxy is there whatever becomes of the engine
        for verb, *more in words:
            assert mixed.srprov("lab", verb, "robot2", *more).code == 0
        assert mixed.shell("robot2", "docker", "run", "--rm", "busybox", "uname", "-m").out.strip() == "aarch64"


def test_one_experiment_comes_up_on_both_each_container_of_its_own_architecture(mixed: Mixed) -> None:
    planned = mixed.run("plan", mixed.edf, "--json").json
    images = {one["robot"]: one for one in planned["steps"] if one["module"] == "image"}
    assert len({one["name"] for one in images.values()}) == 1, "one tag for all"
    assert "built here" in images["robot1"]["cause"] and "built here" in images["robot2"]["cause"]
    assert "copied from robot1" in images["robot3"]["cause"]
    mixed.apply(mixed.edf)
    tag = images["robot1"]["name"]
    pings = " && ".join(f"ping -c 1 -W 5 on-{other} >/dev/null" for other in ROBOTS)
    for robot, machine in ROBOTS.items():
        inside = ("docker", "exec", f"srprov.both.on-{robot}", "sh", "-c", f"uname -m && cat /arch && {pings}")
        assert mixed.shell(robot, *inside).out.split() == [machine, machine]
        assert mixed.image(robot, tag)["Architecture"] == IMAGES[machine]
    assert mixed.image("robot1", tag)["Id"] == mixed.image("robot3", tag)["Id"] != mixed.image("robot2", tag)["Id"]
    second = mixed.run("plan", mixed.edf, "--json").json
    assert second["steps"] == []


@pytest.mark.soak
def test_a_robot_with_an_emulator_says_so(mixed: Mixed) -> None:
    """As Debian's qemu-user-static has registered it, on a robot where somebody has installed that."""
    entry = f":qemu-aarch64:M::{arm64.MAGIC}:{arm64.MASK}:{arm64.INTERPRETER}:OPF"
    mounted = "/proc/sys/fs/binfmt_misc"
    mixed.shell("robot1", "mount", "-t", "binfmt_misc", "binfmt_misc", mounted)
    try:
        if not Path("/proc/sys/fs/binfmt_misc/qemu-aarch64").exists():
            mixed.shell("robot1", "sh", "-c", f"printf '%s' '{entry}' > {mounted}/register")
        robots = mixed.srprov("facts", "-i", str(mixed.inventory), "--json", env=mixed.env).json["robots"]
        assert {name: one["emulates"] for name, one in robots.items()} == {
            "robot1": ["arm64"],
            "robot2": [],
            "robot3": [],
        }
    finally:
        mixed.shell("robot1", "sh", "-c", f"echo -1 > {mounted}/qemu-aarch64; umount {mounted}")


@pytest.mark.soak
def test_a_known_image_for_another_architecture_is_not_copied(mixed: Mixed) -> None:
    """Its id is one that this machine had built under that tag, for the robots that run it."""
    mixed.apply(mixed.edf)
    tag = str(mixed.inspect("robot2", "srprov.both.on-robot2")["Config"]["Image"])
    mixed.shell("robot2", "docker", "save", "-o", "/tmp/other.tar", tag)
    content = mixed.shell("robot2", "base64", "/tmp/other.tar").out
    (mixed.site.disk("robot1") / "upper/var/other.b64").write_text(content, encoding="ascii")
    mixed.shell("robot1", "sh", "-c", "base64 -d /var/other.b64 | docker load")
    mixed.shell("robot3", "sh", "-c", f"docker rm -f srprov.both.on-robot3; docker rmi {tag}")
    for way in ("thin", "whole"):
        applied = mixed.run("apply", mixed.edf, "--yes", "--json", "--settle", "0", "--copy", way)
        failed = [one for one in applied.json["steps"] if one["outcome"] == "failed"]
        assert len(failed) == 1 and "it is an image for arm64, and the robot runs amd64" in failed[0]["message"], (
            applied
        )
        assert tag not in mixed.shell("robot3", "docker", "images", "--format", "{{.Repository}}:{{.Tag}}").out


@pytest.mark.soak
def test_an_image_that_is_not_there_for_a_robot_is_refused_when_it_is_pulled_or_before(mixed: Mixed) -> None:
    """The mirror has Debian for this machine's architecture alone."""
    service = {"image": "debian:bookworm", "command": ["sleep", "86400"], "robot": "robot2"}
    file = mixed.experiment("debian", {"one": service})
    failed = [one for one in mixed.apply(file, 3)["steps"] if one["outcome"] == "failed"]
    assert len(failed) == 1 and "it is an image for amd64, and the robot runs arm64" in failed[0]["message"], failed
    assert mixed.shell("robot2", "docker", "images", "-q", "debian:bookworm").out == ""
    assert mixed.run("lock", file).code == 0
    refused = mixed.run("plan", file)
    assert refused.code == 8 and "its image debian is only for linux/amd64 (is arm64)" in refused.err, refused
    assert mixed.run("lock", mixed.edf).code == 0
    assert '"platforms": ["linux/amd64", "linux/arm64"]' in Path(mixed.folder, "both.lock").read_text(encoding="utf-8")
