"""Images go from robot to robot without what is there already, by the word of the robots' interface counters."""

from __future__ import annotations

import gzip
import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from srprov.definitions import load_inventory
from srprov.lab import state
from srprov.transport import connect
from srprov.transport.registry_copy import pull_image
from srprov.transport.ssh_session import SshSession
from tests.lab.conftest import Lab, part_of_lab
from tests.unit.transport.test_registry import an_image, tar_of

pytestmark = pytest.mark.lab

MIB = 1 << 20
CLEAN = "docker rm -f $(docker ps -aq); docker image prune -af; rm -f /tmp/base.tar"
TOP, BASE = 4 * MIB, 24 * MIB
RANDOM = "head -c {} /dev/urandom > /tmp/base/noise"
REGISTRY = "127.0.0.1:5078"
CONFIG = f'{{version: 0.1, storage: {{filesystem: {{rootdirectory: /run/reg}}}}, http: {{addr: "{REGISTRY}"}}}}'
PULL = f"""\
set -e; echo "$0" > /run/reg.yml
OTEL_TRACES_EXPORTER=none docker-registry serve /run/reg.yml >/run/reg.log 2>&1 </dev/null & served=$!
trap 'kill $served; rm -rf /run/reg /run/reg.yml' EXIT
n=0; until busybox wget -qO- http://{REGISTRY}/v2/ >/dev/null 2>&1; do n=$((n + 1)); [ $n -lt 100 ]; sleep 0.1; done
docker load -q -i /tmp/base.tar; docker tag base:1 {REGISTRY}/base:1; docker push -q {REGISTRY}/base:1
docker image prune -af; [ -z "$(docker images -q)" ]
docker pull -q {REGISTRY}/base:1; docker tag {REGISTRY}/base:1 base:1; docker rmi {REGISTRY}/base:1
"""
"""The robot gets its base by pull, and has nothing of it before."""


def received(lab: Lab, robot: str) -> int:
    """Give the bytes that a robot received from outside, by the kernel's word."""
    lines = lab.shell(robot, "cat", "/proc/net/dev").out.splitlines()
    counters = {name.strip(): rest.split() for name, _, rest in (line.partition(":") for line in lines) if rest}
    return int(counters["eth0"][0])


def root(lab: Lab, robot: str) -> Path:
    """Give a robot's root folder as this machine sees it."""
    booted = state.read_robot(lab.site, robot)
    assert booted is not None
    return Path(f"/proc/{booted.init.pid}/root")


def flip(path: Path) -> tuple[Path, bytes]:
    """Change a byte in the middle of a file; give what was in it before."""
    content = path.read_bytes()
    wrong = bytearray(content)
    wrong[len(wrong) // 2] ^= 1
    path.write_bytes(wrong)
    return path, content


class Job:
    """An experiment whose one service runs an image on a base of the lab's own."""

    def __init__(self, lab: Lab, folder: Path, robots: list[str]) -> None:
        self.lab, self.folder = lab, folder
        self.env = {"XDG_STATE_HOME": str(folder / "state"), "XDG_CACHE_HOME": str(folder / "cache")}
        self.inventory = part_of_lab(lab, robots, folder / "lab.yml")
        cdf = "cdf: 1\nname: top\nbase: base:1\nfiles: [{src: top, dest: /top}]\ncommand: [sleep, '86400']\n"
        (folder / "x.cdf").write_text(cdf, encoding="utf-8")

    def cache(self, size: int) -> Path:
        """Give the one file of the cache of layers that has about this size."""
        near = [one for one in (self.folder / "cache/srprov/blobs").iterdir() if abs(one.stat().st_size - size) < 9999]
        assert len(near) == 1, near
        return near[0]

    def change(self, top: bytes) -> None:
        """Put something else into the image."""
        (self.folder / "top").write_bytes(top)

    def on(self, *robots: str) -> str:
        """Write the EDF for these robots; give its path."""
        services = {f"on-{robot}": {"cdf": "x.cdf", "robot": robot, "stop_signal": "SIGKILL"} for robot in robots}
        path = self.folder / "job.edf"
        path.write_text(json.dumps({"edf": 1, "name": "copies", "services": services}), encoding="utf-8")
        return str(path)

    def apply(self, *robots: str, more: tuple[str, ...] = ()) -> Any:
        """Apply it there, and give what was reported."""
        words = ("apply", self.on(*robots), "-i", self.inventory, "--yes", "--settle", "0", "--reassign", "--json")
        applied = self.lab.srprov(*words, *more, env=self.env)
        assert applied.code == 0, applied
        return applied.json

    def causes(self, *robots: str, more: tuple[str, ...] = ()) -> dict[str, str]:
        """Give robot -> cause of its image's step, of a plan."""
        planned = self.lab.srprov("plan", self.on(*robots), "-i", self.inventory, "--json", *more, env=self.env)
        assert planned.code == 0, planned
        return {one["robot"]: one["cause"] for one in planned.json["steps"] if one["module"] == "image"}


@pytest.fixture(scope="module")
def job(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Job]:
    """Give an experiment whose base robot2 has built, robot1 (the builder) and robot3 loaded, and robot4 pulled."""
    lab = lab_of_module
    script = f"mkdir -p /tmp/base && cd /tmp/base && {RANDOM.format(BASE)} && "
    script += "printf 'FROM busybox\\nCOPY noise /noise\\n' > Dockerfile && docker build -q -t base:1 . && "
    script += "docker save base:1 -o /tmp/base.tar && rm -rf /tmp/base"
    lab.shell("robot2", "sh", "-c", script)
    for robot in ("robot1", "robot3", "robot4"):
        (root(lab, robot) / "tmp/base.tar").write_bytes((root(lab, "robot2") / "tmp/base.tar").read_bytes())
        load = ("docker", "load", "-q", "-i", "/tmp/base.tar")
        lab.shell(robot, *(load if robot != "robot4" else ("sh", "-c", PULL, CONFIG)))
    found = Job(lab, tmp_path_factory.mktemp("copies"), ["robot1", "robot2", "robot3", "robot4"])
    found.change(b"\0" * 100)
    yield found
    found.lab.srprov("destroy", found.on("robot1"), "-i", found.inventory, "--yes", env=found.env)
    for robot in ("robot1", "robot2", "robot3", "robot4"):
        lab.shell(robot, "sh", "-c", CLEAN, check=False)


def test_what_is_there_is_not_sent_however_it_came(job: Job) -> None:
    """By build on robot2, by load on robot3, by pull on robot4; only the layer above is sent, as the plan says."""
    lab, top, robots = job.lab, os.urandom(TOP), ("robot1", "robot2", "robot3", "robot4")
    job.change(top)
    packed = len(gzip.compress(top, 1))
    before = {robot: received(lab, robot) for robot in robots[1:]}
    made = job.apply(*robots)
    sent = {robot: received(lab, robot) - count for robot, count in before.items()}
    assert all(packed < count < 1.05 * packed for count in sent.values()), (packed, sent)
    name = next(one["id"].partition("image:")[2] for one in made["steps"] if "/image:" in one["id"])
    ids = {lab.shell(robot, "docker", "image", "inspect", "-f", "{{.Id}}{{.RootFS}}", name).out for robot in before}
    assert len(ids) == 1 and not root(lab, "robot1").joinpath("var/lib/srprov/.images").exists()

    before = {robot: received(lab, robot) for robot in robots}
    assert job.apply(*robots)["changed"] == 0
    assert all(received(lab, robot) - count < 200_000 for robot, count in before.items())
    lab.shell("robot3", "sh", "-c", f"docker rm -f srprov.copies.on-robot3; docker rmi {name}")
    cause = job.causes(*robots)["robot3"]
    told = re.fullmatch(r"not on the robot; copied from robot1, 1 of 3 layers, ([0-9.]+) MiB", cause)
    assert told, cause
    flipped, content = flip(job.cache(packed))
    running = lab.containers("robot2", running=True)
    before_again = received(lab, "robot3")
    job.apply(*robots)
    assert abs(float(told[1]) * MIB / (received(lab, "robot3") - before_again) - 1) < 0.05
    assert flipped.read_bytes() == content, "the layer with a wrong byte was not sent, but read again"
    ids |= {lab.shell("robot3", "docker", "image", "inspect", "-f", "{{.Id}}{{.RootFS}}", name).out}
    assert len(ids) == 1 and lab.containers("robot2", running=True) == running


def listening(lab: Lab, robot: str) -> set[str]:
    """Give the TCP ports of a robot's loopback that somebody listens on, by the kernel's word."""
    return set(lab.shell(robot, "sh", "-c", "ss -Hltn | awk '{print $4}'").out.split())


def names(lab: Lab, robot: str) -> str:
    """Give all names of a robot's images, also those by digest."""
    listed = lab.shell(robot, "docker", "images", "-a", "--digests", "--format", "{{.Repository}}@{{.Digest}}").out
    return "\n".join(sorted(listed.splitlines()))  # Docker has no order for those of the same second


@pytest.fixture
def no_forwards(job: Job) -> Iterator[None]:
    """Let robot3's sshd forward no ports."""
    config = root(job.lab, "robot3") / "etc/ssh/sshd_config"
    text = config.read_text(encoding="utf-8")
    for words in (f"AllowTcpForwarding no\n{text}", text):
        config.write_text(words, encoding="utf-8")
        job.lab.shell("robot3", "sh", "-c", "kill -HUP $(cat /run/sshd.pid)")
        if words != text:
            yield


@pytest.mark.usefixtures("no_forwards")
def test_an_engine_pulls_from_a_registry_of_which_nothing_is_left_or_gets_the_image_whole(
    job: Job, tmp_path: Path
) -> None:
    lab, before, events = job.lab, listening(job.lab, "robot4"), tmp_path / "events"
    job.change(os.urandom(TOP))
    made = job.apply("robot1", "robot3", "robot4", more=("--copy", "registry", "--events", str(events)))
    name = next(one["id"].partition("image:")[2] for one in made["steps"] if "robot4/image:" in one["id"])
    found = [lab.shell(f"robot{n}", "docker", "image", "inspect", "-f", "{{.Id}}", name).out for n in (1, 3, 4)]
    assert len(set(found)) == 1
    assert "127.0.0.1" not in names(lab, "robot4") and listening(lab, "robot4") == before
    told = [one["text"] for one in map(json.loads, events.read_text(encoding="utf-8").splitlines()) if "text" in one]
    assert any("through a registry: " in one and "MiB copied" in one for one in told), told
    why = "is sent whole: sshd forwards no port: AllowTcpForwarding or PermitListen forbids it"
    assert [one for one in told if "sent whole" in one] == [f"{name} {why}"]


def test_a_served_layer_with_one_wrong_byte_is_refused_by_the_engine(job: Job, tmp_path: Path) -> None:
    """What had the name before has it still, and what runs of it goes on."""
    lab, image = job.lab, an_image(tmp_path, (tar_of(b"base" * 1000, "base"), tar_of(os.urandom(1 << 20), "top")))
    flip(image.layers[1].path)
    lab.shell(
        "robot4", "sh", "-c", "docker tag base:1 srprov/wrong:1; docker run -d --name old srprov/wrong:1 sleep 600"
    )
    session = connect(load_inventory([job.inventory]).hosts["robot4"])
    assert isinstance(session, SshSession)
    try:
        before = names(lab, "robot4")
        client, forwards = session.engine.client, session.connection.forwards
        reply = pull_image(image, "srprov/wrong:1", client, forwards, 60.0, lambda _size: None)
        assert not reply.ok and image.layers[1].compressed in reply.err, reply
        assert names(lab, "robot4") == before and "old" in lab.containers("robot4", running=True)
    finally:
        session.close()


def test_images_that_are_built_ahead_are_all_that_comes_and_all_that_apply_needs(job: Job) -> None:
    """One robot builds, another gets a copy; no container is made, and the next plan has no image."""
    job.change(b"ahead")
    words = (job.on("robot1", "robot3"), "-i", job.inventory, "--reassign")
    before = {robot: set(job.lab.shell(robot, "docker", "ps", "-aq").out.split()) for robot in ("robot1", "robot3")}
    built = job.lab.srprov("build", *words, "--yes", "--json", env=job.env)
    assert built.code == 0 and built.json["changed"] == 2, built
    (name,) = {one["id"].partition("image:")[2] for one in built.json["steps"]}
    ids = {job.lab.shell(robot, "docker", "image", "inspect", "-f", "{{.Id}}", name).out for robot in before}
    after = {robot: set(job.lab.shell(robot, "docker", "ps", "-aq").out.split()) for robot in before}
    assert len(ids) == 1 and after == before
    assert job.causes("robot1", "robot3") == {}
    shown = job.lab.srprov("build", "--show", words[0], env=job.env)
    assert f"# image: {name}\n" in shown.out and "FROM base:1\n" in shown.out, shown
