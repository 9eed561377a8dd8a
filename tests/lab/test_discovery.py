"""Middleware finds its peers on real robots, by each `network.discovery` of the EDF. Long: images are built."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.lab.conftest import ROOT, Lab, busybox, edf, part_of_lab
from tests.lab.looks import ids, log_of, wait_until
from tests.lab.test_examples import Running, flood

pytestmark = [pytest.mark.lab, pytest.mark.soak, pytest.mark.timeout(1500)]

EVERYONE = '''\
"""Say who it is twice a second, and print everybody who was heard as soon as somebody new is."""

import os
import socket

from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from greeting import Greeting, join, stopping

participant, topic = join()
writer, reader, heard = DataWriter(participant, topic), DataReader(participant, topic), set()
print("uri:", os.environ.get("CYCLONEDDS_URI"), flush=True)
turn = 0
while not stopping.wait(0.02):  # a reader keeps the last greeting only
    turn += 1
    if turn % 25 == 0:
        writer.write(Greeting(sender=socket.gethostname(), number=turn))
    new = {one.sender for one in reader.take(N=100) if isinstance(one, Greeting)} - heard
    heard |= new
    if new:
        print("heard:", *sorted(heard), flush=True)
'''


def applied(lab: Lab, path: str) -> Running:
    """Apply an EDF on the whole lab."""
    done = lab.srprov("apply", path, "-i", str(lab.inventory), "--yes", "--settle", "0", "--json")
    assert done.code == 0, done
    return Running(lab, json.loads(done.out)["instance"], path, str(lab.inventory), done.json)


@pytest.mark.parametrize(
    "name", ["chatter-fastdds/experiment", "chatter-fastdds/static-peers", "chatter-zenoh/experiment"]
)
def test_peers_find_each_other_without_multicast(lab: Lab, name: str) -> None:
    """Where no multicast gets from robot to robot, a publisher that comes back is heard."""
    example = applied(lab, str(ROOT / "examples" / f"{name}.edf"))
    flood(lab, example.home.values(), "off")
    assert lab.srprov("restart", example.path, *example.home, "-i", example.inventory, "--yes").code == 0
    pattern = r"heard: hello from publisher #([0-9]+)"
    known = len(example.numbers("subscriber", pattern))
    wait_until(lambda: len(example.numbers("subscriber", pattern)) >= known + 10, 60, "ten greetings")
    assert lab.srprov("destroy", example.path, "-i", example.inventory, "--yes").code == 0


@pytest.mark.parametrize("network", ["overlay", "both"])
def test_a_new_peer_is_found_without_multicast_and_restarts_nobody(lab: Lab, tmp_path: Path, network: str) -> None:
    """It hears the publisher, which runs on with an older list; also when it shares its robot's network."""
    robots = ["robot1", "robot2", "robot3"]
    inventory = part_of_lab(lab, robots, tmp_path / "lab.yml")
    path = peers(tmp_path, network, later=False)
    words = ("-i", inventory, "--yes", "--settle", "0", "--allow", "host-network")
    assert lab.srprov("apply", path, *words).code == 0
    wait_until(lambda: "heard:" in "".join(log_of(lab, "robot2", "srprov.peers.first")), 60, "the first hears it")
    flood(lab, robots, "off")
    before = ids(lab, robots, "peers")
    assert lab.srprov("apply", peers(tmp_path, network, later=True), *words).code == 0
    wait_until(lambda: "heard:" in "".join(log_of(lab, "robot3", "srprov.peers.later")), 60, "the later one hears it")
    after = ids(lab, robots, "peers")
    assert after.pop("srprov.peers.later") and after == before
    assert lab.srprov("destroy", path, "-i", inventory, "--yes").code == 0


def peers(folder: Path, network: str, *, later: bool) -> str:
    """Write an experiment with a publisher and one subscriber, or two; a robot of each is a member from the first."""
    for one in ("dds.cdf", "greeting.py", "publisher.py", "subscriber.py"):
        shutil.copy(ROOT / "examples" / "chatter-dds" / one, folder)
    subscribe = {"cdf": "dds.cdf", "command": ["python3", "/opt/chatter/subscriber.py"]}
    services = {
        "publisher": {"cdf": "dds.cdf", "command": ["python3", "/opt/chatter/publisher.py"], "robot": "robot1"},
        "first": {**subscribe, "robot": "robot2"},
        "member": busybox(robot="robot3"),
        **({"later": {**subscribe, "robot": "robot3", "network": network}} if later else {}),
    }
    path = folder / "experiment.edf"
    more = {"network": {"discovery": "static-peers"}, "placement": {"slots_per_robot": 2}}
    path.write_text(edf("peers", services, **more))
    return str(path)


@pytest.mark.parametrize("discovery", ["multicast", "static-peers"])
def test_twelve_participants_on_twelve_robots_discover_each_other(lab: Lab, tmp_path: Path, discovery: str) -> None:
    """Each hears the other eleven; with static peers while no multicast gets from robot to robot."""
    for one in ("dds.cdf", "greeting.py", "publisher.py", "subscriber.py"):
        shutil.copy(ROOT / "examples" / "chatter-dds" / one, tmp_path)
    (tmp_path / "everyone.py").write_text(EVERYONE)
    service = {
        "cdf": "dds.cdf", "command": ["python3", "/opt/everyone.py"], "replicas": 12,
        "volumes": ["./everyone.py:/opt/everyone.py:ro"], "environment": {"PYTHONPATH": "/opt/chatter"},
    }  # fmt: skip
    path = tmp_path / "experiment.edf"
    whole = {"edf": 1, "name": "twelve", "services": {"one": service}, "network": {"discovery": discovery}}
    path.write_text(json.dumps(whole))
    example = applied(lab, str(path))
    assert len(set(example.home.values())) == 12
    if discovery == "static-peers":
        flood(lab, example.home.values(), "off")
        assert lab.srprov("restart", example.path, *example.home, "-i", example.inventory, "--yes").code == 0
    everybody = "heard: " + " ".join(sorted(example.home))

    def last(service: str) -> str:
        lines = log_of(lab, example.home[service], f"srprov.twelve.{service}")
        began = max(number for number, line in enumerate(lines) if line.startswith("uri:"))
        return lines[-1] if lines[began + 1 :] else ""

    wait_until(lambda: all(last(one) == everybody for one in example.home), 90, "everybody heard all")
    assert lab.srprov("destroy", example.path, "-i", example.inventory, "--yes").code == 0
