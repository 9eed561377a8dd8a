"""Services on their robot's own network that have an address on the overlay too: `network: both`."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, Lab, busybox, causes, changed, edf, part_of_lab
from tests.lab.looks import address_of, begin_on, ids, reached, wait_until

pytestmark = pytest.mark.lab

ROBOTS = ["robot1", "robot2", "robot3"]
WEB = ("busybox", "httpd", "-f", "-p", "8081")
NAMES = {"web", "second", "client", "third"}


def experiment(folder: Path, web_on: str) -> str:
    """Write an experiment with two services of `both` on one robot, and one elsewhere; give its path."""
    services: dict[str, dict[str, Any]] = {
        "web": busybox(*WEB, network="both", robot=web_on),
        "second": busybox(network="both", robot="robot1"),
        "client": busybox(robot="robot2"),
        "third": busybox(network="both", robot="robot3"),
    }
    path = folder / "experiment.edf"
    path.write_text(edf("both", services, placement={"slots_per_robot": 2}), encoding="utf-8")
    return str(path)


def bridge(lab: Lab, robot: str) -> dict[str, Any]:
    """Give the bridge of the instance on a robot, by the kernel's word."""
    found = json.loads(lab.shell(robot, "ip", "-j", "addr", "show", "type", "bridge").out)
    (one,) = [link for link in found if link and link["ifname"].startswith("srpb")]
    assert isinstance(one, dict)
    return one


def on_bridge(lab: Lab, robot: str) -> set[str]:
    """Give the addresses that services have on a robot's bridge: all but the network's own."""
    return {one["local"] for one in bridge(lab, robot)["addr_info"] if one["family"] == "inet"} - {
        lab.shell(robot, "docker", "network", "inspect", "-f", "{{(index .IPAM.Config 0).Gateway}}", "srprov.both")
        .out.strip()
    }  # fmt: skip


def run(lab: Lab, *words: str) -> Any:
    done = lab.srprov(*words, "--json")
    assert done.code == 0, done
    return done.json


def test_services_of_both_are_reached_on_the_overlay_and_have_their_robots_network(lab: Lab, tmp_path: Path) -> None:
    """Their names resolve to addresses on their robots' bridges; what drifts is mended, and moving restarts nobody."""
    inventory = part_of_lab(lab, ROBOTS, tmp_path / "lab.yml")
    path = experiment(tmp_path, "robot1")
    allow = ("--allow", "host-network", "--yes", "--settle", "0")
    run(lab, "apply", path, "-i", inventory, *allow)

    modes = {
        name: lab.inspect("robot1", f"srprov.both.{name}")["HostConfig"]["NetworkMode"] for name in ("web", "second")
    }
    assert set(modes.values()) == {"host"}
    rows = run(lab, "status", path, "-i", inventory)["services"]
    address = {row["service"]: row["address"] for row in rows}
    assert on_bridge(lab, "robot1") == {address["web"], address["second"]}
    assert on_bridge(lab, "robot3") == {address["third"]} and on_bridge(lab, "robot2") == set()
    assert address_of(lab, "robot2", "srprov.both.client") == address["client"]

    for robot, name in (("robot2", "client"), ("robot1", "second"), ("robot3", "third")):
        targets = NAMES | set(address.values())
        assert reached(lab, robot, f"srprov.both.{name}", targets) == targets, name
    fetch = ("docker", "exec", "srprov.both.client", "timeout", "5", "wget", "-q", "-O", "-")
    assert "root:" in lab.shell("robot2", *fetch, "http://web:8081/etc/passwd").out
    entries = json.loads(lab.shell("robot2", "bridge", "-j", "fdb", "show").out)
    known = {one["mac"] for one in entries if one.get("dst")}
    assert {bridge(lab, robot)["address"] for robot in ("robot1", "robot3")} <= known, "unicast is not sent to all"

    tried = run(lab, "probe", path, "-i", inventory)
    assert tried["ok"], tried
    streams = {(one["from"], one["to"]) for one in tried["pairs"] if one["tcp"] and one["multicast"]}
    ends = {f"{row['service']}@{row['robot']}" for row in rows}
    assert streams == set(itertools.permutations(ends, 2))
    mend(lab, path, inventory, address["second"])
    move(lab, tmp_path, inventory, address)
    gone = lab.srprov("destroy", path, "-i", inventory, "--yes")
    assert gone.code == 0, gone
    assert [lab.leftovers(robot) for robot in ROBOTS] == [NOTHING] * 3


def mend(lab: Lab, path: str, inventory: str, address: str) -> None:
    """Take an address away and add one by hand: the first is put back, the other stays, no container is touched."""
    name = bridge(lab, "robot1")["ifname"]
    lab.shell("robot1", "ip", "addr", "del", f"{address}/32", "dev", name)
    lab.shell("robot1", "ip", "addr", "add", "192.0.2.77/32", "dev", name)
    seen = lab.srprov("status", path, "-i", inventory, "--json")
    assert {row["service"]: row["problem"] for row in seen.json["services"]}["second"] == "address"
    before = ids(lab, ROBOTS, "both")
    step = {f"robot1/vxlan:{name.replace('srpb', 'srpv')}": "update: addresses of services: 1 to add, 0 to remove"}
    assert causes(run(lab, "plan", path, "-i", inventory)) == step
    assert changed(
        run(lab, "apply", path, "-i", inventory, "--allow", "host-network", "--yes", "--settle", "0")
    ) == set(step)
    assert {address, "192.0.2.77"} < on_bridge(lab, "robot1")
    assert ids(lab, ROBOTS, "both") == before
    assert causes(run(lab, "plan", path, "-i", inventory)) == {}


def move(lab: Lab, folder: Path, inventory: str, address: dict[str, str]) -> None:
    """Move a service: it keeps its address, is reached there at once, and no other container is made anew."""
    before = ids(lab, ROBOTS, "both")
    enter = ("docker", "exec", "srprov.both.client")
    script = "echo $$ >/tmp/pid; exec ping -i 0.1 web >/tmp/pings"
    pings = begin_on(lab, "robot2", *enter, "timeout", "120", "sh", "-c", script)

    def answers() -> list[int]:
        said = lab.shell("robot2", *enter, "sh", "-c", "cat /tmp/pings || true").out
        return [int(number) for number in re.findall(r"\bseq=([0-9]+) .*\n", said)]

    wait_until(lambda: len(answers()) >= 5, 20, "pings before the move")
    path = experiment(folder, "robot3")
    run(lab, "apply", path, "-i", inventory, "--allow", "host-network", "--yes", "--settle", "0")
    assert on_bridge(lab, "robot3") == {address["web"], address["third"]}
    assert on_bridge(lab, "robot1") == {address["second"], "192.0.2.77"}
    enough = len(answers()) + 5
    wait_until(lambda: len(answers()) >= enough, 20, "pings after the move")
    lab.shell("robot2", *enter, "sh", "-c", "kill $(cat /tmp/pid)")
    pings.communicate(timeout=120)
    seen = answers()
    longest = max(after - one for one, after in itertools.pairwise(seen))
    assert longest <= 30, f"{longest / 10} s without an answer"
    after = ids(lab, ROBOTS, "both")
    assert {name for name in after if after[name] != before[name]} == {"srprov.both.web"}
