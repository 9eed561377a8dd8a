"""Overlays over networks that are not one plain LAN, and on robots that boot: IPv6, two subnets, mixed MTUs, systemd.

What gets through is looked at with ping, and its own bit against fragments, from inside the containers' networks.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from itertools import permutations
from pathlib import Path
from typing import Any

import pytest

from tests.lab.conftest import NOTHING, ROBOTS, Lab, busybox, causes, edf, make_whole, part_of_lab, scrub
from tests.lab.looks import address_of, reached, wait_until

pytestmark = pytest.mark.lab

SPEC = """\
robots:
  robot1: {ipv6: true, mtu: 1400}
  robot2: {ipv6: true, systemd: true}
  robot3: {lan: 2, mtu: 9000}
  robot4: {systemd: true}
"""
ICMP = 28
"""Bytes of the IPv4 and ICMP headers of a ping."""


@pytest.fixture(scope="module")
def lab(lab_session: Lab, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Give a lab whose first three robots have other networks; afterwards they are as they were."""
    path = tmp_path_factory.mktemp("underlays") / "lab-spec.yml"
    path.write_text(SPEC, encoding="utf-8")
    up = lab_session.srprov("lab", "up", "-n", str(ROBOTS), "--spec", str(path))
    assert up.code == 0, up
    yield lab_session
    scrub(lab_session)
    make_whole(lab_session)


def apply(lab: Lab, folder: Path, name: str, homes: Mapping[str, str], **extra: dict[str, Any]) -> str:
    """Apply an experiment with one container per robot, which the probe finds in order; give the inventory.

    `extra` are variables of the inventory.
    """
    path = folder / "experiment.edf"
    path.write_text(edf(name, {one: busybox(robot=robot) for one, robot in homes.items()}), encoding="utf-8")
    inventory = part_of_lab(lab, sorted(homes.values()), folder / "lab.yml", **extra)
    done = lab.srprov("apply", str(path), "-i", inventory, "--yes", "--settle", "0", "--json")
    assert done.code == 0, done
    tried = done.json["probe"]
    assert tried["ok"] and tried["pairs"] == 4 * len(homes) * (len(homes) - 1) + 2 * len(homes), tried
    return inventory


def check_mtu(lab: Lab, name: str, homes: Mapping[str, str], mtu: int) -> None:
    """Expect that containers send each other packets of that many bytes unfragmented, and not one byte more."""
    containers = {service: f"srprov.{name}.{service}" for service in homes}
    addresses = {service: address_of(lab, robot, containers[service]) for service, robot in homes.items()}
    for one, other in permutations(homes, 2):
        pid = str(lab.inspect(homes[one], containers[one])["State"]["Pid"])
        ping = ("nsenter", "-t", pid, "-n", "ping", "-M", "do", "-c", "1", "-W", "2", addresses[other], "-s")
        fits = lab.shell(homes[one], *ping, str(mtu - ICMP), check=False)
        assert fits.code == 0, f"{one} to {other}: {fits}"
        larger = lab.shell(homes[one], *ping, str(mtu - ICMP + 1), check=False)
        assert larger.code != 0 and f"mtu={mtu}" in larger.out + larger.err, f"{one} to {other}: {larger}"


def outer(lab: Lab, robot: str, name: str) -> dict[str, Any]:
    """Give what the kernel says of an instance's VXLAN link."""
    links = json.loads(lab.shell(robot, "ip", "-j", "-d", "link", "show", "type", "vxlan").out)
    (data,) = (one["linkinfo"]["info_data"] for one in links if one.get("ifalias") == f"srprov:{name}")
    assert isinstance(data, dict)
    return data


def test_an_overlay_over_ipv6_carries_packets_of_its_whole_mtu(lab: Lab, tmp_path: Path) -> None:
    """The links are IPv6, SSH to one robot is too, and packets of 70 bytes less than the smaller MTU go through."""
    homes = {"left": "robot1", "right": "robot2"}
    there = {robot: str(lab.site.address6(robot)) for robot in homes.values()}
    inventory = apply(lab, tmp_path, "six", homes, robot2={"ansible_host": there["robot2"]})
    assert {robot: outer(lab, robot, "six").get("local6") for robot in homes.values()} == there
    check_mtu(lab, "six", homes, 1400 - 70)
    probe_over_ipv6(lab, ("probe", str(tmp_path / "experiment.edf"), "-i", inventory, "--json"), there)


def probe_over_ipv6(lab: Lab, words: tuple[str, ...], there: Mapping[str, str]) -> None:
    """The underlay is tried by its IPv6 addresses; a link with too small an MTU, and a port that is shut, are named."""
    right = lab.srprov(*words)
    assert right.code == 0 and right.json["ok"], right
    under = {one["address"] for one in right.json["endpoints"] if one["kind"] == "underlay"}
    assert under == set(there.values())
    assert [one["failed"] for one in right.json["underlay"]] == [[], []]

    lab.shell("robot2", "ip", "link", "set", "dev", "eth0", "mtu", "1380")
    narrow = lab.srprov(*words)
    lab.shell("robot2", "ip", "link", "set", "dev", "eth0", "mtu", "1500")
    drop = ("INPUT", "-s", there["robot1"], "-p", "udp", "--dport", "4789", "-j", "DROP")
    lab.shell("robot2", "ip6tables", "-I", *drop)
    shut = lab.srprov(*words)
    lab.shell("robot2", "ip6tables", "-D", *drop)
    for said, kind, word in ((narrow, "mtu", "eth0 is 1380"), (shut, "firewall", there["robot1"])):
        assert said.code == 3, said
        (cause,) = said.json["causes"]
        assert cause["cause"] == kind and word in cause["text"] and cause["robots"] == ["robot1", "robot2"], cause


def test_an_overlay_spans_subnets_and_takes_the_smallest_mtu(lab: Lab, tmp_path: Path) -> None:
    """Behind a router one robot has jumbo frames; of the others, one has 1400 bytes: the overlay has 1350."""
    homes = {"narrow": "robot1", "far": "robot3", "plain": "robot4"}
    gateway = str(lab.site.subnet_of(2).network_address + 1)
    route = lab.shell("robot3", "ip", "route", "get", str(lab.site.address("robot4"))).out
    assert f"via {gateway}" in route, route
    apply(lab, tmp_path, "wide", homes, robot1={"srprov_underlay": "eth0"})
    vteps = {robot: outer(lab, robot, "wide")["local"] for robot in homes.values()}
    assert vteps["robot3"] == str(lab.site.address("robot3", 2)) != str(lab.site.address("robot3"))
    check_mtu(lab, "wide", homes, 1400 - 50)
    again = lab.srprov("apply", str(tmp_path / "experiment.edf"), "-i", str(tmp_path / "lab.yml"), "--yes", "--json")
    assert again.code == 0 and again.json["changed"] == 0, again


def test_a_robot_that_boots_is_cut_off_until_an_apply_or_restores_itself(lab: Lab, tmp_path: Path) -> None:
    """Without `persist`, plan and status say why; with it the unit makes the link, and destroy takes the unit away."""
    scrub(lab)
    homes = {"left": "robot2", "right": "robot4"}
    services = {one: busybox(robot=robot, restart="always") for one, robot in homes.items()}
    path, inventory = tmp_path / "experiment.edf", part_of_lab(lab, ["robot2", "robot4"], tmp_path / "lab.yml", **{
        "robot2": {"srprov_underlay": "eth0"}})  # fmt: skip
    words = (str(path), "-i", inventory)

    def apply(*allowed: str, **network: bool) -> Any:
        path.write_text(edf("boots", services, network=network), encoding="utf-8")
        allow = [word for kind in ("restart-always", *allowed) for word in ("--allow", kind)]
        return lab.srprov("apply", *words, "--yes", "--settle", "0", "--json", *allow)

    def boot() -> None:
        assert lab.srprov("lab", "restart", "robot4").code == 0
        wait_until(lambda: "srprov.boots.right" in lab.containers("robot4", running=True), 30, "its container")

    def reaches() -> bool:
        return bool(reached(lab, "robot4", "srprov.boots.right", ["left"]))

    first = apply()
    assert first.code == 0, first
    boot()
    ((link, cause),) = ((name, why) for name, why in causes(planned(lab, words)).items() if "/vxlan:" in name)
    assert link.startswith("robot4/") and cause == "create: isolated since reboot"
    shown = lab.srprov("status", *words, "--json").json
    assert ("robot4", "vxlan", "isolated") in [(one["robot"], one["kind"], one["problem"]) for one in shown["links"]]
    assert not reaches()

    refused = apply(persist=True)
    assert refused.code == 9 and "network.persist: unit" in refused.err, refused
    done = apply("unit", persist=True)
    assert done.code == 0, done
    unit = "/etc/systemd/system/srprov-boots.service"
    verified = lab.shell("robot4", "systemd-analyze", "verify", unit, check=False)
    assert verified.code == 0 and "srprov-boots" not in verified.err, verified
    boot()
    wait_until(reaches, 30, "the link that the boot restores")
    again = apply("unit", persist=True)
    assert again.code == 0 and again.json["changed"] == 0, again
    gone = lab.srprov("destroy", *words, "--yes")
    assert gone.code == 0, gone
    assert [lab.leftovers(robot) for robot in homes.values()] == [NOTHING, NOTHING]


def planned(lab: Lab, words: tuple[str, ...]) -> dict[str, Any]:
    """Give the plan of what is there, as `plan --json` prints it."""
    done = lab.srprov("plan", *words, "--json", "--allow", "restart-always")
    assert done.code == 0, done
    assert isinstance(done.json, dict)
    return done.json


def test_a_robot_without_systemd_cannot_restore_itself(lab: Lab, tmp_path: Path) -> None:
    path = tmp_path / "experiment.edf"
    path.write_text(edf("boots", {"one": busybox(robot="robot1")}, network={"persist": True}), encoding="utf-8")
    done = lab.srprov("plan", str(path), "-i", part_of_lab(lab, ["robot1"], tmp_path / "lab.yml"), "--allow", "unit")
    assert done.code == 5 and "network.persist needs systemd, which does not run on robot1" in done.err, done
