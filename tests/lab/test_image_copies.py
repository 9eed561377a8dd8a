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
from jsonschema import Draft202012Validator

from srprov import data
from srprov.definitions import load_inventory
from srprov.lab import state
from srprov.session import no_progress
from srprov.sizes import size_text
from srprov.transport import connect
from srprov.transport.image_progress import Meter
from srprov.transport.image_there import Room
from srprov.transport.registry_copy import Pull
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
HIDE = "for one in /var/lib/docker/image/overlay2/layerdb/sha256/*/cache-id; do mv $one $one.hidden; done"
"""The engine knows these by heart once it has started."""
SHOW = "for one in /var/lib/docker/image/overlay2/layerdb/sha256/*/cache-id.hidden; do mv $one ${one%.hidden}; done"


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
        # bytes are counted: none of the probe's
        words = ("apply", self.on(*robots), "-i", self.inventory, "--yes", "--settle", "0", "--no-probe", "--json")
        words = (*words, "--reassign")
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
    kept = {one.name: one.stat().st_size for one in (job.folder / "cache/srprov/blobs").iterdir()}
    assert max(kept.values()) < 1.05 * packed, f"the base, which each has by its name, was read from robot1: {kept}"
    name = next(one["id"].partition("image:")[2] for one in made["steps"] if "/image:" in one["id"])
    copies = [one["message"] for one in made["steps"] if "/image:" in one["id"] and not one["id"].startswith("robot1/")]
    assert copies == ["sent 1 of 3 layers, 4.0 MiB"] * 3
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


def test_a_layer_that_the_engines_files_do_not_show_is_saved_by_the_engine(job: Job) -> None:
    """All others come from the files: the engine writes no image of 24 MiB for a layer of some bytes."""
    lab, robot1 = job.lab, root(job.lab, "robot1")
    wrapper, calls = robot1 / "usr/local/bin/docker", robot1 / "tmp/calls"
    wrapper.write_text(f'#!/bin/sh\necho "$*" >> /tmp/{calls.name}\nexec /usr/bin/docker "$@"\n', encoding="utf-8")
    wrapper.chmod(0o755)
    calls.touch()
    try:
        for content, saves, before in ((b"first", 0, "true"), (b"second", 1, HIDE)):
            job.change(content)
            built = job.lab.srprov("build", job.on("robot1"), "-i", job.inventory, "--yes", "--json", env=job.env)
            assert built.code == 0, built
            lab.shell("robot1", "sh", "-c", before)
            job.apply("robot1", "robot2")
            assert calls.read_text(encoding="utf-8").count("save sha256:") == saves
            assert (
                lab.shell("robot2", "docker", "exec", "srprov.copies.on-robot2", "cat", "/top").out == content.decode()
            )
    finally:
        wrapper.unlink()
        lab.shell("robot1", "sh", "-c", SHOW)


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
    assert [one for one in told if "is sent whole" in one] == [f"{name} {why}"]


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
        reply = Pull(image, "srprov/wrong:1", client, 60.0, Meter("it", no_progress), Room()).run(forwards)
        assert not reply.ok and image.layers[1].compressed in reply.err, reply
        assert names(lab, "robot4") == before and "old" in lab.containers("robot4", running=True)
    finally:
        session.close()


OLD = "srprov/top:0123456789abcdef"
BUILD_OLD = f"""\
printf 'FROM base:1\\nLABEL srprov.instance=.build\\nRUN head -c {2 * MIB} /dev/urandom > /old\\nLABEL srprov.cdf=top
LABEL srprov.instance=""\\n' | docker build -q -t {OLD} -
"""
MINE = """\
docker tag base:1 mine:base && printf 'FROM %s\\nRUN touch /x\\n' "$0" | docker build -q -t mine:1 - &&
printf 'FROM mine:1\\nLABEL srprov.instance=.build\\nRUN false\\n' | docker build -q --force-rm -
docker create --name own "$1"
"""


def layers_bytes(lab: Lab, robot: str) -> int:
    """Give the bytes of all layers of a robot's images, as its engine counts them."""
    asked = "curl -s --unix-socket /run/docker.sock http://x/system/df"
    return int(json.loads(lab.shell(robot, "sh", "-c", asked).out)["LayersSize"])


def labelled(lab: Lab, robot: str) -> dict[str, str]:
    """Give id -> labels of all images of a robot, steps of builds too."""
    script = "docker image inspect -f '{{.Id}} {{json .Config.Labels}}' $(docker images -aq)"
    lines = lab.shell(robot, "sh", "-c", script).out.splitlines()
    return {key: labels for key, _, labels in (line.partition(" ") for line in lines)}


def test_images_come_ahead_of_an_apply_and_those_that_nobody_uses_go(job: Job) -> None:
    """A container that runs, one of somebody else that is stopped, the last run, and another name keep an image."""
    lab, robots = job.lab, ("robot1", "robot3")
    words = (job.on(*robots), "-i", job.inventory, "--reassign", "--yes", "--json")
    tags = []
    for verb in (("apply", "--settle", "0"), ("build",)):
        job.change(os.urandom(MIB))
        before = {robot: lab.shell(robot, "docker", "ps", "-aq").out for robot in robots}
        done = lab.srprov(verb[0], *words, *verb[1:], env=job.env)
        assert done.code == 0, done
        tags += sorted({one["id"].partition("image:")[2] for one in done.json["steps"] if "/image:" in one["id"]})
    used, ahead = tags
    ids = {lab.shell(robot, "docker", "image", "inspect", "-f", "{{.Id}}", ahead).out for robot in robots}
    assert len(ids) == 1 and before == {robot: lab.shell(robot, "docker", "ps", "-aq").out for robot in robots}
    assert job.causes(*robots) == {}, "an apply has no image to bring"

    for robot in robots:
        lab.shell(robot, "sh", "-c", BUILD_OLD)
    lab.shell("robot1", "sh", "-c", MINE, used, OLD)
    every = {robot: labelled(lab, robot) for robot in robots}
    inventory = ("-i", job.inventory, "--limit", ",".join(robots))
    listed = lab.srprov("images", *inventory, "--json", env=job.env)
    assert listed.code == 0 and not [*Draft202012Validator(data.schema("images")).iter_errors(listed.json)], listed
    told = {one["tags"][0]: one for one in listed.json["robots"]["robot1"]["images"] if one["tags"]}
    assert told[used]["instances"] == ["copies"] and told[OLD]["containers"] == ["own"]
    assert told[ahead]["named_by"] == ["copies"] and told[ahead]["arch"] == "amd64"

    size = layers_bytes(lab, "robot3")
    pruned = lab.srprov("images", "prune", *inventory, "--yes", env=job.env)
    assert pruned.code == 0, pruned
    freed = size - layers_bytes(lab, "robot3")
    assert re.search(f"robot3: [0-9]+ images?, {size_text(freed)} will be freed", pruned.out) and freed >= 2 * MIB, (
        pruned
    )
    kept = {robot: lab.shell(robot, "docker", "images", "--format", "{{.Repository}}:{{.Tag}}").out for robot in robots}
    assert {one: OLD in kept[one] for one in robots} == {"robot1": True, "robot3": False}
    assert all(one in kept[robot] for one in (used, ahead, "base:1") for robot in robots)
    assert "mine:1" in kept["robot1"] and "<none>" not in kept["robot1"] + kept["robot3"]
    for robot, images in every.items():
        gone = images.keys() - labelled(lab, robot).keys()
        assert gone and all("srprov.instance" in images[one] for one in gone), gone
    assert "verb=prune" in lab.shell("robot3", "tail", "-n", "1", "/var/log/srprov.log").out
    lab.shell("robot1", "sh", "-c", "docker rm own; docker rmi mine:1 mine:base")
