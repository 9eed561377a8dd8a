"""`srprov probe`: everything works, and what does not is named with its pairs and its cause; faults are made by hand.

Four robots with a service each; in `make soak` twelve, and each of seven faults alone.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator

from srprov import data
from tests.lab.conftest import ROBOTS, Done, Lab, busybox, edf, part_of_lab

pytestmark = pytest.mark.lab

COUNT = min(ROBOTS, 12) if os.environ.get("SRPROV_SOAK") else 4
NAMES = [f"robot{number}" for number in range(1, COUNT + 1)]
SERVICE = {robot: f"s{robot.removeprefix('robot')}" for robot in NAMES}
WRONG_MAC = "02:de:ad:be:ef:01"


@dataclass
class Probed:
    lab: Lab
    file: str
    inventory: str
    applied: Any
    """What the apply that made it all said."""

    def probe(self, *more: str) -> Done:
        return self.lab.srprov("probe", self.file, "-i", self.inventory, *more)

    def json(self, code: int) -> Any:
        done = self.probe("--json")
        assert done.code == code, done
        Draft202012Validator(data.schema("probe")).validate(done.json)
        return done.json

    def on(self, robot: str, script: str) -> str:
        return self.lab.shell(robot, "sh", "-c", script).out

    def link(self, robot: str) -> str:
        return self.on(robot, "ls /sys/class/net | grep ^srpv").strip()

    def pid(self, robot: str) -> int:
        return int(self.lab.inspect(robot, f"srprov.probed.{SERVICE[robot]}")["State"]["Pid"])

    def inside(self, robot: str, script: str) -> str:
        """Run a script of the robot's programs in the network namespace of its service's container."""
        return self.on(robot, f"nsenter --net=/proc/{self.pid(robot)}/ns/net sh -c '{script}'")

    def address(self, robot: str) -> str:
        """Return the address of a robot's service, by Docker's word."""
        networks = self.lab.inspect(robot, f"srprov.probed.{SERVICE[robot]}")["NetworkSettings"]["Networks"]
        return str(networks["srprov.probed"]["IPAddress"])


@pytest.fixture(scope="module")
def probed(lab_of_module: Lab, tmp_path_factory: pytest.TempPathFactory) -> Probed:
    folder = tmp_path_factory.mktemp("probe")
    inventory = part_of_lab(lab_of_module, NAMES, folder / "lab.yml")
    file = folder / "probed.edf"
    services = {SERVICE[robot]: busybox(robot=robot) for robot in NAMES}
    file.write_text(edf("probed", services), encoding="utf-8")
    done = lab_of_module.srprov("apply", str(file), "-i", inventory, "--yes", "--settle", "0", "--json")
    assert done.code == 0, done
    return Probed(lab_of_module, str(file), inventory, done.json)


def ends(robot: str) -> list[str]:
    """Return what a robot's own address and its service are called."""
    return [robot, f"{SERVICE[robot]}@{robot}"]


def between(first: str, second: str) -> set[tuple[str, str]]:
    """Return all pairs between two robots, in both directions."""
    one_way = {(a, b) for a in ends(first) for b in ends(second)}
    return one_way | {(b, a) for a, b in one_way}


def of(name: str) -> set[tuple[str, str]]:
    """Return all pairs of one endpoint."""
    others = [one for robot in NAMES for one in ends(robot) if one != name]
    return {(name, one) for one in others} | {(one, name) for one in others}


def named(said: Any) -> set[tuple[str, str]]:
    return {(a, b) for cause in said["causes"] for a, b in cause["pairs"]}


def test_everybody_reaches_everybody_and_nothing_is_left_on_robots(probed: Probed) -> None:
    """Also services that are pinged by hand say so; the program and its file are gone."""
    said = probed.json(0)
    assert said["ok"] and said["mtu"] == 1450 and said["causes"] == []
    names = [name for robot in NAMES for name in ends(robot)]
    assert {(one["from"], one["to"]) for one in said["pairs"]} == {(a, b) for a in names for b in names if a != b}
    for one in said["pairs"]:
        services = "@" in one["from"] and "@" in one["to"]
        assert (one["mtu"], one["tcp"], one["multicast"]) == (1450, services or None, services or None), one
        assert one["received"] and 0 < one["rtt_ms"][0] <= one["rtt_ms"][1] <= one["rtt_ms"][2] < 1000
    assert len(said["underlay"]) == COUNT * (COUNT - 1)
    assert {one["mtu"] for one in said["underlay"]} == {1500}
    for robot in NAMES:
        left = probed.on(robot, "find /var/lib/srprov /run/srprov -name '.probe*'; cat /proc/[0-9]*/comm | sort -u")
        assert ".probe" not in left and "8" not in left.split()  # it runs as file descriptor 8
    shown = probed.probe()
    assert shown.code == 0 and f"{len(said['pairs'])} of {len(said['pairs'])} pairs" in shown.out
    assert shown.out.splitlines()[0].split()[-COUNT:] == NAMES


def test_an_apply_tries_what_it_changed_and_ends_with_3_when_that_fails(probed: Probed) -> None:
    """The whole result is in the run's record; nothing is tried where nothing changed, nor with --no-probe."""
    apply = ("apply", probed.file, "-i", probed.inventory, "--yes", "--settle", "0", "--json")
    count = 2 * COUNT * (2 * COUNT - 1)
    first = probed.applied["probe"]
    assert (first["ok"], first["pairs"], first["failed"], first["causes"]) == (True, count, 0, [])
    record = json.loads((Path(probed.applied["run"]) / "probe.json").read_text(encoding="utf-8"))
    Draft202012Validator(data.schema("probe")).validate(record)
    assert record["ok"] and len(record["pairs"]) == count
    shown = probed.lab.srprov("status", probed.file, "-i", probed.inventory, "--network")
    assert shown.code == 0 and f"{count} of {count} pairs" in shown.out, shown
    unchanged = probed.lab.srprov(*apply)
    assert (unchanged.code, unchanged.json["probe"]) == (0, None), unchanged
    with port_blocked(probed):
        probed.on("robot1", f"ip link del {probed.link('robot1')}")
        done = probed.lab.srprov(*apply)
        assert done.code == 3 and done.json["failed"] == 0, done
        assert [one["cause"] for one in done.json["probe"]["causes"]] == ["port"]
        assert done.json["probe"]["causes"][0]["text"] in done.err and "overlay does not work" in done.err
        probed.on("robot1", f"ip link del {probed.link('robot1')}")
        done = probed.lab.srprov(*apply, "--no-probe")
        assert (done.code, done.json["probe"]) == (0, None), done


@contextlib.contextmanager
def underlay_cut(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    assert probed.lab.srprov("lab", "partition", "robot1", "--from", "robot2").code == 0
    yield between("robot1", "robot2")
    assert probed.lab.srprov("lab", "heal", "robot1", "--from", "robot2").code == 0


@contextlib.contextmanager
def port_blocked(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    """On this machine, between the robots: neither of them can see why."""
    site = probed.lab.site
    rule = ["-s", str(site.address("robot2")), "-d", str(site.address("robot3")), "-p", "udp", "--dport", "4789"]
    subprocess.run(["iptables", "-w", "-I", "FORWARD", *rule, "-j", "DROP"], check=True)
    yield between("robot2", "robot3")
    subprocess.run(["iptables", "-w", "-D", "FORWARD", *rule, "-j", "DROP"], check=True)


@contextlib.contextmanager
def mtu_lowered(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    probed.on("robot3", "ip link set dev eth0 mtu 1400")
    yield set().union(*(between("robot3", other) for other in NAMES if other != "robot3"))
    probed.on("robot3", "ip link set dev eth0 mtu 1500")


@contextlib.contextmanager
def entry_deleted(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    entry = f"00:00:00:00:00:00 dev {probed.link('robot1')} dst {probed.lab.site.address('robot4')} self"
    probed.on("robot1", f"bridge fdb del {entry}; ip neigh flush all")
    yield between("robot1", "robot4")
    probed.on("robot1", f"bridge fdb append {entry} permanent")


@contextlib.contextmanager
def arp_wrong(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    there = probed.address("robot2")
    probed.inside("robot4", f"ip neigh replace {there} lladdr {WRONG_MAC} dev eth0 nud permanent")
    one, other = ends("robot4")[1], ends("robot2")[1]
    yield {(one, other), (other, one)}
    probed.inside("robot4", f"ip neigh del {there} dev eth0")


@contextlib.contextmanager
def rule_added(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    rule = f"FORWARD -s {probed.address('robot1')} -d {probed.address('robot3')} -j DROP"
    probed.on("robot3", f"iptables -w -I {rule}")
    one, other = ends("robot1")[1], ends("robot3")[1]
    yield {(one, other), (other, one)}
    probed.on("robot3", f"iptables -w -D {rule}")


@contextlib.contextmanager
def port_down(probed: Probed) -> Iterator[set[tuple[str, str]]]:
    index = json.loads(probed.inside("robot2", "ip -j link show dev eth0"))[0]["link_index"]
    links = json.loads(probed.on("robot2", "ip -j link show"))
    port = next(one["ifname"] for one in links if one["ifindex"] == index)
    probed.on("robot2", f"ip link set dev {port} down")
    yield of(ends("robot2")[1])
    probed.on("robot2", f"ip link set dev {port} up")


Fault = Callable[[Probed], contextlib.AbstractContextManager[set[tuple[str, str]]]]
FAULTS: dict[str, tuple[Fault, str, tuple[str, ...]]] = {
    "underlay": (underlay_cut, "underlay", ("robot1 - robot2", "in both directions")),
    "port": (port_blocked, "port", ("robot2 - robot3", "UDP port 4789", "from robot2 to robot3")),
    "mtu": (mtu_lowered, "mtu", ("robot3", "MTU of eth0 is 1400, and 1500 are needed")),
    "fdb": (entry_deleted, "fdb", ("robot1 - robot4", "00:00:00:00:00:00 dst")),
    "arp": (arp_wrong, "arp", ("robot4 - robot2", WRONG_MAC)),
    "firewall": (rule_added, "firewall", ("robot3", "-j DROP", "FORWARD")),
    "interface": (port_down, "interface", ("robot2", "is down", "cut off from everybody")),
}
OFTEN = ("port", "arp")
"""Those that `make test` looks at; all seven are `make soak`'s."""


def looked_at(name: str) -> Any:
    return pytest.param(name, id=name, marks=[] if name in OFTEN else [pytest.mark.soak])


@pytest.mark.parametrize("name", [looked_at(name) for name in FAULTS])
def test_a_fault_is_named_with_exactly_its_pairs_and_its_cause(probed: Probed, name: str) -> None:
    """And when it is gone, everything works again."""
    make, cause, words = FAULTS[name]
    with make(probed) as pairs:
        said = probed.json(3)
    assert [one["cause"] for one in said["causes"]] == [cause], json.dumps(said["causes"], indent=1)
    if name == "fdb":  # services have entries of their own: those that the other asked first reach each other
        assert (ends("robot1")[1], ends("robot4")[1]) in named(said) <= pairs
        pairs = named(said)
    assert named(said) == pairs, (sorted(named(said) - pairs), sorted(pairs - named(said)))
    assert {(one["from"], one["to"]) for one in said["pairs"] if one["failed"]} == pairs
    text = said["causes"][0]["text"]
    assert all(word in text for word in words), text
    assert said["causes"][0]["hint"] and not said["ok"]
