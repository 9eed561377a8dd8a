"""Robots with the Docker of Debian 13, with and without containerd's store, beside one with the machine's Docker."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import pytest

from tests.lab.conftest import NAME, Lab
from tests.lab.newer_docker import programs, put

pytestmark = [pytest.mark.lab, pytest.mark.soak]

CDF = """\
cdf: 1
name: greeter
base: busybox
run: ["head -c 3000000 /dev/urandom > /large"]
command: [sh, -c, "sha256sum /large; exec sleep 86400"]
stop_signal: SIGKILL
"""
CLASSIC, NEWER, PLAIN = "robot1", "robot2", "robot3"


@pytest.fixture(scope="module")
def newer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    """Give a lab: robot1 has the machine's Docker, robot2 the newer one with containerd's store, robot3 without."""
    lab = Lab(tmp_path_factory.mktemp("newer"), f"{NAME}-newer")
    (lab.folder / "greeter.cdf").write_text(CDF, encoding="utf-8")
    try:
        up = lab.srprov("lab", "up", "--robots", "3")
        assert up.code == 0, up
        archive = programs(lab.folder / "debian")
        for robot, containerd in ((NEWER, True), (PLAIN, False)):
            said = put(lab, robot, archive, containerd=containerd)
            assert int(said["ServerVersion"].split(".")[0]) >= 26
            assert said["Driver"] == ("overlayfs" if containerd else "overlay2")
        yield lab
    finally:
        lab.srprov("lab", "down")


def apply(lab: Lab, name: str, *more: str) -> dict[str, Any]:
    """Bring up a service on each robot, with a home of its own; return the report of a plan afterwards."""
    env = {f"XDG_{kind}_HOME": str(lab.folder / name / kind) for kind in ("STATE", "CACHE")}
    path = lab.folder / f"{name}.edf"
    services = {f"on-{robot}": {"cdf": "greeter.cdf", "robot": robot} for robot in (CLASSIC, NEWER, PLAIN)}
    path.write_text(json.dumps({"edf": 1, "name": name, "services": services}), encoding="utf-8")
    words = (str(path), "-i", str(lab.inventory), *more)
    done = lab.srprov("apply", *words, "--yes", "--settle", "1", env=env)
    assert done.code == 0, str(done)
    planned = lab.srprov("plan", *words, "--json", env=env)
    assert planned.code == 0, planned
    return dict(planned.json)


def clean(lab: Lab, robot: str) -> None:
    """Leave a robot no container and no image but busybox, pulled as its registry has it."""
    ended = (
        "docker rm -f $(docker ps -aq); docker rmi -f $(docker images -q); docker image prune -af; docker pull busybox"
    )
    lab.shell(robot, "sh", "-c", f"({ended}) >/dev/null 2>&1; docker image inspect busybox")


@pytest.mark.parametrize("builder", [CLASSIC, NEWER, PLAIN])
def test_an_image_gets_from_each_store_to_each_other_one(newer: Lab, builder: str) -> None:
    """Each has the base from its registry, where it is not compressed as srprov sends it."""
    for robot in (CLASSIC, NEWER, PLAIN):
        clean(newer, robot)
    (newer.folder / "builders.yml").write_text(json.dumps({"builders": {"hosts": {builder: None}}}), encoding="utf-8")
    name = f"from-{builder}"
    # with containerd's store Docker 26 does not tell of which images a base's name may be
    allowed = ("--allow", "built-image", "--allow", "engine-fetch") if builder == NEWER else ()
    assert apply(newer, name, "-i", str(newer.folder / "builders.yml"), *allowed)["steps"] == []
    said = {
        robot: newer.shell(robot, "docker", "logs", f"srprov.{name}.on-{robot}").out
        for robot in (CLASSIC, NEWER, PLAIN)
    }
    assert len(set(said.values())) == 1 and "/large" in said[builder], "built once, the same bytes everywhere"
    layers = {
        newer.shell(
            robot,
            "docker",
            "inspect",
            "-f",
            "{{.RootFS.Layers}}",
            newer.inspect(robot, f"srprov.{name}.on-{robot}")["Config"]["Image"],
        ).out
        for robot in (CLASSIC, NEWER, PLAIN)
    }
    assert len(layers) == 1 and layers != {"[]\n"}
    for robot in (NEWER, PLAIN):
        assert "127.0.0.1" not in newer.shell(robot, "docker", "images").out, "nothing of the way it came is left"
